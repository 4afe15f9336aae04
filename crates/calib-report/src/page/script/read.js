// Reading values: under the pointer, or with the arrow keys.
const reading = {
  hover(event) {
    if (!this.inside(event)) return this.clear();
    this.show(this.fx(this.point(event)[0]), event);
  },

  // Index of the point of `series` nearest to fraction `f`; points are in order.
  nearest(series, f) {
    if (series.dense) return clamp(Math.round(this.axes.x.value(f) / series.step), 0, series.y.length - 1);
    let [low, high] = [0, series.x.length - 1];
    const at = (i) => this.axes.x.at(series.x[i]);
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (at(middle) < f) low = middle; else high = middle;
    }
    return Math.abs(at(low) - f) <= Math.abs(at(high) - f) ? low : high;
  },

  show(f, event) {
    const series = this.visible();
    this.clear();
    if (!series.length) return;
    // The cursor snaps to the nearest point of any curve.
    const snapped = series.map((s) => this.axes.x.at(position(s, this.nearest(s, f))));
    const at = snapped.reduce((a, b) => (Math.abs(b - f) < Math.abs(a - f) ? b : a));
    const [x, y, w, h] = this.data.plot;
    const px = this.px(at);
    if (px < x - 1 || px > x + w + 1) return;
    this.reading = at;
    make("path", { class: "cursor", d: `M${px} ${y}v${h}`, fill: "none" }, this.overlay);
    const value = this.axes.x.value(at);
    const heading = this.data.x.names ? this.data.x.names[Math.round(value)] : `${this.data.x.label}: ${number(value, 4)}`;
    const lines = [];
    for (const s of series) {
      const i = this.nearest(s, at);
      const place = this.axes.x.at(position(s, i));
      if (Math.abs(place - at) > 0.02 || Number.isNaN(s.y[i])) continue;
      const v = s.y[i];
      let content = "diverged";
      if (Number.isFinite(v)) {
        content = number(v);
        if (s.low && s.low[i] !== null) content += ` (${number(s.low[i])} to ${number(s.high[i])})`;
        const py = this.py(this.axes[s.side].at(v));
        if (py >= y - 1 && py <= y + h + 1)
          make("circle", { class: "dot", cx: this.px(place), cy: py, r: 5 }, this.overlay);
      }
      lines.push([s.label, content]);
    }
    const head = document.createElement("b");
    head.textContent = heading;
    this.tip.replaceChildren(head, ...lines.map((cells) => {
      const row = document.createElement("div");
      for (const cell of cells) row.append(Object.assign(document.createElement("span"), { textContent: cell }));
      return row;
    }));
    this.tip.hidden = false;
    const box = this.svg.getBoundingClientRect();
    const left = (px / this.svg.viewBox.baseVal.width) * box.width;
    const width = this.tip.offsetWidth;
    this.tip.style.left = `${left + 14 + width > box.width ? Math.max(0, left - width - 14) : left + 14}px`;
    const top = event ? event.clientY - box.top - 20 : 20;
    this.tip.style.top = `${clamp(top, 0, Math.max(0, box.height - this.tip.offsetHeight))}px`;
    return `${heading}. ${lines.map((cells) => cells.join(": ")).join(". ")}`;
  },

  // Left and right walk over the points of a curve, a hundredth of what is in view at a time; up and down change
  // the curve; with Shift they move the view.
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const moves = {
      "+": () => this.closer(0.5), "=": () => this.closer(0.5), "-": () => this.closer(2), "0": () => this.zoom(WHOLE),
      Escape: () => this.zoom(WHOLE),
    };
    if (event.shiftKey) Object.assign(moves, { ArrowLeft: () => this.pan(-0.25), ArrowRight: () => this.pan(0.25) });
    if (moves[event.key]) {
      event.preventDefault();
      moves[event.key]();
      this.live.textContent = `Shown: ${this.data.x.label} from ${this.at(this.view.x0)} to ${this.at(this.view.x1)}.`;
      return;
    }
    const curves = this.visible();
    if (!curves.length) return;
    if (event.key === "ArrowUp" || event.key === "ArrowDown")
      this.curve = (this.curve + (event.key === "ArrowDown" ? 1 : curves.length - 1)) % curves.length;
    const s = curves[Math.min(this.curve, curves.length - 1)];
    const [first, last] = [this.nearest(s, this.view.x0), this.nearest(s, this.view.x1)];
    const step = Math.max(1, Math.round((last - first) / 100));
    const now = this.reading === undefined ? first - step : this.nearest(s, this.reading);
    const next = { ArrowRight: now + step, ArrowLeft: now - step, ArrowUp: now, ArrowDown: now, Home: first, End: last }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    const place = clamp(next, first, last);
    const said = this.show(this.axes.x.at(position(s, place)));
    const named = event.key === "ArrowUp" || event.key === "ArrowDown" ? `${s.label}. ` : "";
    this.live.textContent = said ? named + said : "Outside the zoomed range.";
  },

  // The value at a fraction of the horizontal axis, as text.
  at(f) {
    const value = this.axes.x.value(f);
    return this.data.x.names ? this.data.x.names[clamp(Math.round(value), 0, this.data.x.names.length - 1)] : number(value);
  },
};
Object.assign(Chart.prototype, reading);
