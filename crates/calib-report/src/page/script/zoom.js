// Zooming: by a drag, the wheel with Ctrl held, buttons or keys. What is drawn then has all the detail of the data.
const WHOLE = Object.freeze({ x0: 0, x1: 1, y0: 0, y1: 1 });
// Deeper than this, positions are rounding errors.
const DEEPEST = 1e-4;

const zooming = {
  brush(event) {
    const [x, y, w, h] = this.data.plot;
    const [px, py] = this.point(event);
    const [ax, bx] = [this.from[0], px].map((v) => clamp(v, x, x + w)).sort((a, b) => a - b);
    const [ay, by] = [this.from[1], py].map((v) => clamp(v, y, y + h)).sort((a, b) => a - b);
    // A mostly level drag zooms along the horizontal axis only.
    const flat = by - ay < 24;
    this.selected = { ax, bx, ay: flat ? y : ay, by: flat ? y + h : by };
    this.overlay.replaceChildren();
    this.tip.hidden = true;
    const { ay: top, by: bottom } = this.selected;
    make("rect", { class: "brush", x: ax, y: top, width: bx - ax, height: bottom - top }, this.overlay);
  },

  release() {
    const s = this.selected;
    const dragged = this.from && s && s.bx - s.ax > 8;
    this.selected = undefined;
    this.clear();
    if (dragged) this.zoom({ x0: this.fx(s.ax), x1: this.fx(s.bx), y0: this.fy(s.by), y1: this.fy(s.ay) });
  },

  // The wheel alone scrolls the page.
  wheel(event) {
    if (!event.ctrlKey || !this.inside(event)) return;
    event.preventDefault();
    this.closer(event.deltaY < 0 ? 0.8 : 1.25, this.fx(this.point(event)[0]));
  },

  // Scales the horizontal range by `factor` around fraction `at`: what is being read, or the middle.
  closer(factor, at = this.reading ?? (this.view.x0 + this.view.x1) / 2) {
    const { x0, x1 } = this.view;
    const width = Math.min(1, (x1 - x0) * factor);
    const from = clamp(at - ((at - x0) / (x1 - x0)) * width, 0, 1 - width);
    this.zoom({ ...this.view, x0: from, x1: from + width });
  },

  // Moves the range by a share of its width.
  pan(share) {
    const width = this.view.x1 - this.view.x0;
    const from = clamp(this.view.x0 + share * width, 0, 1 - width);
    this.zoom({ ...this.view, x0: from, x1: from + width });
  },

  zoom(view) {
    if (view.x1 - view.x0 < DEEPEST || view.y1 - view.y0 < DEEPEST) return;
    this.view = { ...view };
    const whole = Object.keys(WHOLE).every((end) => Math.abs(view[end] - WHOLE[end]) < 1e-9);
    if (whole) this.view = { ...WHOLE };
    this.reset.hidden = whole;
    this.clear();
    const [x, y, w, h] = this.data.plot;
    // At rest there is room for symbols at the ends of the axis; a zoomed plot ends where its axes do.
    const clip = this.svg.querySelector("clipPath rect");
    clip.setAttribute("x", whole ? x - 7 : x);
    clip.setAttribute("width", whole ? w + 14 : w);
    const moveX = (px) => this.px((px - x) / w);
    const moveY = (py) => this.py(1 - (py - y) / h);
    const [sx, sy] = [1 / (this.view.x1 - this.view.x0), 1 / (this.view.y1 - this.view.y0)];
    for (const group of this.groups) {
      const lines = group.querySelector(".scaled");
      const series = this.data.series[group.dataset.series];
      if (series.dense) this.detail(lines, series, whole);
      else lines?.setAttribute("transform", `matrix(${sx} 0 0 ${sy} ${moveX(0)} ${moveY(0)})`);
    }
    for (const symbol of this.svg.querySelectorAll(".series .symbol")) {
      symbol.home ??= symbol.getAttribute("transform").match(/-?[\d.]+/g).map(Number);
      const [px, py] = symbol.home;
      symbol.setAttribute("transform", `translate(${moveX(px)} ${symbol.classList.contains("cross") ? py : moveY(py)})`);
    }
    for (const mark of this.svg.querySelectorAll(".rules > *")) {
      // Not by its box: a picture that is not shown has none.
      mark.home ??= Number(mark.getAttribute("x") ?? mark.getAttribute("d").match(/-?[\d.]+/)[0]);
      const to = moveX(mark.home);
      mark.setAttribute("transform", `translate(${to - mark.home} 0)`);
      mark.classList.toggle("off", to < x || to > x + w);
    }
    for (const [axis, markup] of this.original) {
      axis.innerHTML = markup;
      if (!whole) this.redraw(axis);
    }
  },

  // Draws a long series anew: every value in view, or the smallest and largest of each pixel where there are more.
  detail(lines, series, whole) {
    lines.home ??= lines.innerHTML;
    lines.innerHTML = lines.home;
    if (whole) return;
    const [, , w] = this.data.plot;
    const axis = this.axes[series.side];
    const last = series.y.length - 1;
    const index = (f) => this.axes.x.value(f) / series.step;
    const first = clamp(Math.floor(index(this.view.x0)) - 1, 0, last);
    const end = clamp(Math.ceil(index(this.view.x1)) + 1, 0, last);
    const bucket = Math.max(1, Math.floor((end - first) / (2 * w)));
    let d = "";
    let pen = "M";
    const to = (i) => {
      if (!Number.isFinite(series.y[i])) { pen = "M"; return; }
      d += `${pen}${this.px(this.axes.x.at(i * series.step)).toFixed(1)} ${clamp(this.py(axis.at(series.y[i])), -1e4, 1e4).toFixed(1)}`;
      pen = "L";
    };
    for (let i = first; i <= end; i += bucket) {
      if (bucket === 1) { to(i); continue; }
      let [low, high] = [i, i];
      for (let j = i; j < Math.min(i + bucket, end + 1); j++) {
        if (!(series.y[low] <= series.y[j])) low = j;
        if (!(series.y[high] >= series.y[j])) high = j;
      }
      to(Math.min(low, high));
      if (low !== high) to(Math.max(low, high));
    }
    const [path, ...others] = lines.querySelectorAll("path");
    path?.setAttribute("d", d || "M0 0");
    for (const other of others) other.remove();
  },

  // Replaces ticks and grid of one axis by those of the present view; the axis label stays.
  redraw(axis) {
    const [x, y, w, h] = this.data.plot;
    const name = axis.classList[1];
    const label = axis.querySelector("text.ink");
    axis.replaceChildren();
    const line = (d, colour) => make("path", { class: `line ${colour}`, d, fill: "none", stroke: PAPER[colour] }, axis);
    const text = (tx, ty, anchor, content) => {
      const attributes = { class: "muted", x: tx, y: ty, "text-anchor": anchor, "font-size": 13, fill: PAPER.muted };
      make("text", attributes, axis).textContent = content;
    };
    if (name === "x") {
      line(`M${x} ${y + h}h${w}`, "muted");
      for (const [value, content] of ticks(this.axes.x, this.view.x0, this.view.x1, 8)) {
        const px = this.px(this.axes.x.at(value));
        line(`M${px} ${y}v${h}`, "grid");
        line(`M${px} ${y + h}v6`, "muted");
        text(px, y + h + 21, "middle", content);
      }
    } else {
      const right = name === "right";
      const edge = right ? x + w : x;
      for (const [value, content] of ticks(this.axes[name], this.view.y0, this.view.y1, 6)) {
        const py = this.py(this.axes[name].at(value));
        if (!right) line(`M${x} ${py}h${w}`, "grid");
        line(`M${edge} ${py}h${right ? 6 : -6}`, "muted");
        text(edge + (right ? 10 : -10), py + 4.5, right ? "start" : "end", content);
      }
      line(`M${edge} ${y}v${h}`, "muted");
    }
    if (label) axis.append(label);
  },
};
Object.assign(Chart.prototype, zooming);
