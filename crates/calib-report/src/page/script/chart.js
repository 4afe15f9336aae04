// Screens narrower than this see the narrow pictures, as in the style sheet; paper does not.
const narrowScreen = matchMedia("screen and (max-width: 48rem)");

// One chart: its curves, its legend, and the way between pixels and fractions of the full axes.
class Chart {
  constructor(figure) {
    this.figure = figure;
    this.box = figure.querySelector(".plot");
    this.pictures = [...this.box.querySelectorAll("svg")];
    this.tip = figure.querySelector(".tip");
    this.live = figure.querySelector("[aria-live]");
    this.data = JSON.parse(figure.querySelector("script").textContent);
    this.data.series = this.data.series.map(unpacked);
    this.axes = { x: scaled(this.data.x), left: scaled(this.data.left), right: this.data.right && scaled(this.data.right) };
    this.reset = figure.querySelector(".reset");
    this.overlays = this.pictures.map((svg) => make("g", { class: "overlay" }, svg));
    this.originals = this.pictures.map((svg) => new Map([...svg.querySelectorAll(".axis")].map((axis) => [axis, axis.innerHTML])));
    this.view = { ...WHOLE };
    this.curve = 0;
    this.choose();
    this.listen();
  }

  // Goes on with the picture that the screen has room for.
  choose() {
    const place = narrowScreen.matches ? 1 : 0;
    this.svg = this.pictures[place];
    this.data.plot = this.data.plots[place];
    this.groups = [...this.svg.querySelectorAll(".series")];
    this.original = this.originals[place];
    this.overlay = this.overlays[place];
  }

  listen() {
    narrowScreen.addEventListener("change", () => {
      const view = this.view;
      this.zoom(WHOLE);
      this.choose();
      this.zoom(view);
    });
    for (const key of this.figure.querySelectorAll("button.key")) {
      key.addEventListener("click", () => this.toggle(key, key.getAttribute("aria-pressed") !== "true"));
      this.toggle(key, Number(key.dataset.series) < Number(this.figure.dataset.shown));
    }
    this.reset.addEventListener("click", () => {
      this.box.focus({ preventScroll: true });
      this.zoom(WHOLE);
    });
    for (const button of this.figure.querySelectorAll("button.zoom"))
      button.addEventListener("click", () => this.closer(button.dataset.zoom === "in" ? 0.5 : 2));
    for (const button of this.figure.querySelectorAll("button.save"))
      button.addEventListener("click", () => this.save(button.dataset.format));
    for (const svg of this.pictures) {
      svg.addEventListener("pointerdown", (event) => {
        if (event.button !== 0 || event.pointerType === "touch" || !this.inside(event)) return;
        event.preventDefault();
        this.box.focus({ preventScroll: true });
        this.from = this.point(event);
        svg.setPointerCapture(event.pointerId);
      });
      svg.addEventListener("pointermove", (event) => (this.from ? this.brush(event) : this.hover(event)));
      svg.addEventListener("pointerup", () => this.release());
      svg.addEventListener("pointercancel", () => this.clear());
      svg.addEventListener("pointerleave", () => !this.from && this.clear());
      svg.addEventListener("dblclick", () => this.zoom(WHOLE));
      svg.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    }
    this.box.addEventListener("keydown", (event) => this.key(event));
    this.box.addEventListener("blur", () => this.clear());
  }

  toggle(key, on) {
    key.setAttribute("aria-pressed", on);
    for (const group of this.box.querySelectorAll(`.series[data-series="${key.dataset.series}"]`)) group.classList.toggle("off", !on);
  }

  visible() {
    const shown = this.groups.filter((group) => !group.classList.contains("off"));
    return shown.map((group) => this.data.series[group.dataset.series]).filter((series) => series.y.length);
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
}
