"use strict";
// Charts are complete without this script; it adds reading, hiding, zooming and copying.
(() => {
  const SVG = document.documentElement.namespaceURI && document.querySelector("svg")?.namespaceURI;
  const make = (name, attributes, parent) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return parent ? parent.appendChild(element) : element;
  };
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const trimmed = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);

  // Three significant digits, as everywhere else in the report.
  const number = (value, digits = 3) => {
    if (value === 0) return "0";
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    if (exponent < -3 || exponent >= 6) return trimmed(mantissa) + "e" + Number(exponent);
    const places = Math.max(0, digits - 1 - exponent);
    return exponent >= 3 ? Math.round(value).toLocaleString("en-US") : trimmed(value.toFixed(places));
  };

  // Scales map values to fractions of the full axis and back.
  const scaled = (axis) => {
    const log = axis.kind === "log";
    const to = log ? Math.log : (v) => v;
    const back = log ? Math.exp : (v) => v;
    const [min, span] = [to(axis.min), to(axis.max) - to(axis.min)];
    return { ...axis, at: (v) => (log && v <= 0 ? -1 : (to(v) - min) / span), value: (f) => back(min + f * span) };
  };
  const ticks = (axis, from, to, wanted) => {
    const [low, high] = [axis.value(from), axis.value(to)].sort((a, b) => a - b);
    if (axis.kind === "names") return axis.names.map((label, i) => [i, label]).filter(([i]) => i >= low && i <= high);
    const out = [];
    if (axis.kind === "log" && high / low > 8) {
      const every = Math.ceil(Math.log10(high / low) / wanted);
      const digits = high / low < 100 ? [1, 2, 5] : [1];
      for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++)
        for (const d of digits) {
          const value = Number(`${d}e${e}`);
          if (value >= low && value <= high && e % every === 0) out.push([value, e < 0 && axis.min < 5e-3 ? `${d}e${e}` : number(value)]);
        }
      return out;
    }
    const rough = (high - low) / wanted;
    const power = 10 ** Math.floor(Math.log10(rough));
    let step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough * 0.999);
    if (axis.kind === "whole") step = Math.max(1, step);
    const places = clamp(-Math.floor(Math.log10(step * 1.0001)), 0, 20);
    for (let i = Math.ceil(low / step); i <= high / step; i++)
      out.push([i * step, places > 4 ? number(i * step, 4) : (i * step).toLocaleString("en-US", { minimumFractionDigits: places, maximumFractionDigits: places })]);
    return out;
  };

  class Chart {
    constructor(figure) {
      this.figure = figure;
      this.box = figure.querySelector(".plot");
      this.svg = this.box.querySelector("svg");
      this.tip = figure.querySelector(".tip");
      this.live = figure.querySelector("[aria-live]");
      this.data = JSON.parse(figure.querySelector("script").textContent);
      this.axes = { x: scaled(this.data.x), left: scaled(this.data.left), right: this.data.right && scaled(this.data.right) };
      this.groups = [...this.svg.querySelectorAll(".series")];
      this.original = new Map([...this.svg.querySelectorAll(".axis")].map((axis) => [axis, axis.innerHTML]));
      this.reset = figure.querySelector(".reset");
      this.overlay = make("g", { class: "overlay" }, this.svg);
      this.full = { x0: 0, x1: 1, y0: 0, y1: 1 };
      this.view = { ...this.full };
      this.place = -1;
      this.listen();
    }

    listen() {
      for (const key of this.figure.querySelectorAll("button.key")) {
        key.addEventListener("click", () => this.toggle(key, key.getAttribute("aria-pressed") !== "true"));
        this.toggle(key, Number(key.dataset.series) < Number(this.figure.dataset.shown));
      }
      this.reset.addEventListener("click", () => this.zoom(this.full));
      this.svg.addEventListener("pointerdown", (event) => {
        if (event.button !== 0 || event.pointerType === "touch" || !this.inside(event)) return;
        event.preventDefault();
        this.box.focus({ preventScroll: true });
        this.from = this.point(event);
        this.svg.setPointerCapture(event.pointerId);
      });
      this.svg.addEventListener("pointermove", (event) => (this.from ? this.brush(event) : this.hover(event)));
      this.svg.addEventListener("pointerup", (event) => this.release(event));
      this.svg.addEventListener("pointercancel", () => this.clear());
      this.svg.addEventListener("pointerleave", () => !this.from && this.clear());
      this.svg.addEventListener("dblclick", () => this.zoom(this.full));
      this.box.addEventListener("keydown", (event) => this.key(event));
      this.box.addEventListener("blur", () => this.clear());
    }

    toggle(key, on) {
      key.setAttribute("aria-pressed", on);
      this.groups.find((g) => g.dataset.series === key.dataset.series)?.classList.toggle("off", !on);
    }

    // Position of a pointer event in the picture's own pixels.
    point(event) {
      const box = this.svg.getBoundingClientRect();
      const view = this.svg.viewBox.baseVal;
      return [((event.clientX - box.left) * view.width) / box.width, ((event.clientY - box.top) * view.height) / box.height];
    }
    inside(event) {
      const [x, y, w, h] = this.data.plot;
      const [px, py] = this.point(event);
      return px >= x - 8 && px <= x + w + 8 && py >= y && py <= y + h;
    }
    // Between fractions of the full axes and pixels of the present view.
    px(f) { return this.data.plot[0] + ((f - this.view.x0) / (this.view.x1 - this.view.x0)) * this.data.plot[2]; }
    py(f) { return this.data.plot[1] + (1 - (f - this.view.y0) / (this.view.y1 - this.view.y0)) * this.data.plot[3]; }
    fx(px) { return this.view.x0 + ((px - this.data.plot[0]) / this.data.plot[2]) * (this.view.x1 - this.view.x0); }
    fy(py) { return this.view.y0 + (1 - (py - this.data.plot[1]) / this.data.plot[3]) * (this.view.y1 - this.view.y0); }

    clear() {
      this.from = undefined;
      this.overlay.replaceChildren();
      this.tip.hidden = true;
    }

    brush(event) {
      const [x, y, w, h] = this.data.plot;
      const [px, py] = this.point(event);
      const [ax, bx] = [this.from[0], px].map((v) => clamp(v, x, x + w)).sort((a, b) => a - b);
      const [ay, by] = [this.from[1], py].map((v) => clamp(v, y, y + h)).sort((a, b) => a - b);
      // A mostly level drag zooms in time only.
      const flat = by - ay < 24;
      this.selected = { ax, bx, ay: flat ? y : ay, by: flat ? y + h : by };
      this.overlay.replaceChildren();
      this.tip.hidden = true;
      const { ay: top, by: bottom } = this.selected;
      make("rect", { class: "brush", x: ax, y: top, width: bx - ax, height: bottom - top }, this.overlay);
    }

    release() {
      const s = this.selected;
      const dragged = this.from && s && s.bx - s.ax > 8;
      this.selected = undefined;
      this.clear();
      if (dragged) this.zoom({ x0: this.fx(s.ax), x1: this.fx(s.bx), y0: this.fy(s.by), y1: this.fy(s.ay) });
    }

    zoom(view) {
      // Deeper than this, positions are rounding errors.
      if (view.x1 - view.x0 < 1e-4 || view.y1 - view.y0 < 1e-4) return;
      this.view = { ...view };
      const whole = Object.keys(view).every((end) => view[end] === this.full[end]);
      this.reset.hidden = whole;
      this.clear();
      const [x, y, w, h] = this.data.plot;
      const [sx, sy] = [1 / (view.x1 - view.x0), 1 / (view.y1 - view.y0)];
      // At rest there is room for symbols at the ends of the axis; a zoomed plot ends where its axes do.
      const clip = this.svg.querySelector("clipPath rect");
      clip.setAttribute("x", whole ? x - 7 : x);
      clip.setAttribute("width", whole ? w + 14 : w);
      const moveX = (px) => this.px((px - x) / w);
      const moveY = (py) => this.py(1 - (py - y) / h);
      for (const group of this.svg.querySelectorAll(".scaled"))
        group.setAttribute("transform", `matrix(${sx} 0 0 ${sy} ${moveX(0)} ${moveY(0)})`);
      for (const symbol of this.svg.querySelectorAll(".series .symbol")) {
        symbol.home ??= symbol.getAttribute("transform").match(/-?[\d.]+/g).map(Number);
        const [px, py] = symbol.home;
        symbol.setAttribute("transform", `translate(${moveX(px)} ${symbol.classList.contains("cross") ? py : moveY(py)})`);
      }
      for (const mark of this.svg.querySelectorAll(".rules > *")) {
        mark.home ??= mark.getBBox().x + mark.getBBox().width / 2;
        const to = moveX(mark.home);
        mark.setAttribute("transform", `translate(${to - mark.home} 0)`);
        mark.classList.toggle("off", to < x || to > x + w);
      }
      for (const [axis, markup] of this.original) {
        axis.innerHTML = markup;
        if (!whole) this.redraw(axis);
      }
    }

    // Replaces ticks and grid of one axis by those of the present view; the axis label stays.
    redraw(axis) {
      const [x, y, w, h] = this.data.plot;
      const name = axis.classList[1];
      const label = axis.querySelector("text.ink");
      axis.replaceChildren();
      const line = (d, colour) => make("path", { class: `line ${colour}`, d, fill: "none" }, axis);
      const text = (tx, ty, anchor, content) => {
        const attributes = { class: "muted", x: tx, y: ty, "text-anchor": anchor, "font-size": 13 };
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
    }

    hover(event) {
      if (!this.inside(event)) return this.clear();
      this.show(this.fx(this.point(event)[0]), event);
    }

    visible() {
      return this.groups.filter((g) => !g.classList.contains("off")).map((g) => this.data.series[g.dataset.series]);
    }

    // Index of the point of `series` nearest to fraction `f`; points are in order.
    nearest(series, f) {
      let [low, high] = [0, series.x.length - 1];
      const at = (i) => this.axes.x.at(series.x[i]);
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (at(middle) < f) low = middle; else high = middle;
      }
      return Math.abs(at(low) - f) <= Math.abs(at(high) - f) ? low : high;
    }

    show(f, event) {
      const series = this.visible().filter((s) => s.x.length);
      this.clear();
      if (!series.length) return;
      // The cursor snaps to the nearest point of any curve.
      const snapped = series.map((s) => this.axes.x.at(s.x[this.nearest(s, f)]));
      const at = snapped.reduce((a, b) => (Math.abs(b - f) < Math.abs(a - f) ? b : a));
      const [x, y, w, h] = this.data.plot;
      const px = this.px(at);
      if (px < x - 1 || px > x + w + 1) return;
      make("path", { class: "cursor", d: `M${px} ${y}v${h}`, fill: "none" }, this.overlay);
      const value = this.axes.x.value(at);
      const heading = this.data.x.names ? this.data.x.names[Math.round(value)] : `${this.data.x.label}: ${number(value, 4)}`;
      const lines = [];
      for (const s of series) {
        const i = this.nearest(s, at);
        if (Math.abs(this.axes.x.at(s.x[i]) - at) > 0.02) continue;
        const v = s.y[i];
        if (v === null) continue;
        let content = v;
        if (v !== "diverged") {
          content = number(v);
          if (s.low && s.low[i] !== null) content += ` (${number(s.low[i])} to ${number(s.high[i])})`;
          const py = this.py(this.axes[s.side].at(v));
          if (py >= y - 1 && py <= y + h + 1)
            make("circle", { class: "dot", cx: this.px(this.axes.x.at(s.x[i])), cy: py, r: 5 }, this.overlay);
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
    }

    // Arrow keys walk over the points of the first visible curve, a hundredth of a dense one at a time.
    key(event) {
      const first = this.visible()[0];
      if (event.key === "Escape") return this.zoom(this.full);
      const last = first ? first.x.length - 1 : -1;
      const step = Math.max(1, Math.round(last / 100));
      const next = { ArrowRight: this.place + step, ArrowLeft: this.place - step, Home: 0, End: last }[event.key];
      if (next === undefined || last < 0) return;
      event.preventDefault();
      this.place = clamp(next, 0, last);
      this.live.textContent = this.show(this.axes.x.at(first.x[this.place])) ?? "Outside the zoomed range.";
    }

    // Every point drawn, in long form.
    points() {
      const rows = [["curve", this.data.x.label, "value", "low", "high"]];
      for (const s of this.data.series)
        s.x.forEach((x, i) => rows.push([s.label, x, s.y[i] ?? "", s.low?.[i] ?? "", s.high?.[i] ?? ""]));
      return rows.map((row) => row.join("\t")).join("\n");
    }
  }

  const charts = new Map();
  for (const figure of document.querySelectorAll("figure.chart")) charts.set(figure, new Chart(figure));

  const tableText = (table) =>
    [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent.trim()).join("\t")).join("\n");
  const copy = async (text) => {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Pages opened from a disk may not use the clipboard directly.
      const area = Object.assign(document.createElement("textarea"), { value: text });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
  };
  for (const button of document.querySelectorAll(".copy"))
    button.addEventListener("click", async () => {
      const figure = button.closest("figure");
      const box = button.closest("details, .table, .block");
      const dense = figure && button.textContent.includes("points");
      await copy(dense ? charts.get(figure).points() : box.querySelector("table") ? tableText(box.querySelector("table")) : box.querySelector("pre").textContent);
      const before = button.textContent;
      button.textContent = "Copied";
      setTimeout(() => (button.textContent = before), 1500);
    });

  document.querySelector(".theme").addEventListener("click", () => {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
})();
