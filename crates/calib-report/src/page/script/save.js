// Taking a chart away: as a picture, or as its numbers. Nothing leaves the page but to the reader's disk.
const download = (name, type, content) => {
  const link = Object.assign(document.createElement("a"), {
    href: URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type })),
    download: name,
  });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};

const fileName = (title, format) => `${title.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "")}.${format}`;

// Saves the SVG document `picture` as it is, or painted at twice its size.
const savePicture = async (title, format, picture) => {
  const name = fileName(title, format);
  if (format === "svg") return download(name, "image/svg+xml", picture);
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(picture)}`;
  await image.decode();
  const canvas = Object.assign(document.createElement("canvas"), { width: 2 * image.width, height: 2 * image.height });
  const pen = canvas.getContext("2d");
  pen.scale(2, 2);
  pen.drawImage(image, 0, 0, image.width, image.height);
  canvas.toBlob((blob) => download(name, "image/png", blob), "image/png");
};

const saving = {
  save(format) {
    if (format === "csv") download(fileName(this.title(), format), "text/csv", this.numbers(",") + "\n");
    else savePicture(this.title(), format, this.picture());
  },

  title() {
    return this.figure.querySelector("h3").textContent;
  },

  // The chart as it is seen now, as an SVG document on white, with its title and the curves that are shown.
  picture() {
    const svg = this.svg.cloneNode(true);
    for (const gone of svg.querySelectorAll(".overlay, .off, .surface")) gone.remove();
    const { width, height } = this.svg.viewBox.baseVal;
    const content = make("g", {});
    content.append(...[...svg.childNodes].filter((node) => !["title", "desc"].includes(node.nodeName)));
    const head = make("g", { "font-size": 13, fill: PAPER.ink });
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `13px ${svg.getAttribute("font-family")}`;
    let [x, y] = [this.data.plot[0], 54];
    for (const key of this.figure.querySelectorAll('button.key[aria-pressed="true"], span.key')) {
      const label = key.querySelector("span").textContent;
      const room = pen.measureText(label).width + 62;
      if (x > this.data.plot[0] && x + room > width) [x, y] = [this.data.plot[0], y + 22];
      const sample = make("g", { transform: `translate(${x} ${y - 7})` }, head);
      sample.append(...[...key.querySelector("svg").childNodes].map((node) => node.cloneNode(true)));
      make("text", { x: x + 38, y: y + 4.5 }, head).textContent = label;
      x += room;
    }
    make("text", { x: this.data.plot[0], y: 30, "font-size": 17, "font-weight": "bold" }, head).textContent = this.title();
    const down = y + 14;
    content.setAttribute("transform", `translate(0 ${down})`);
    svg.append(make("rect", { width, height: height + down, fill: "#ffffff" }), head, content);
    svg.setAttribute("viewBox", `0 0 ${width} ${height + down}`);
    svg.setAttribute("height", height + down);
    return new XMLSerializer().serializeToString(svg);
  },

  // Every value of the chart, in long form.
  numbers(separator) {
    const quoted = (text) => (/[",\n\t]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const written = (value) => (value === Infinity ? "diverged" : Number.isFinite(value) ? Number(value.toPrecision(6)) : "");
    const rows = [["curve", this.data.x.label, "value", "low", "high"].map(quoted)];
    for (const s of this.data.series)
      s.y.forEach((y, i) => {
        const x = this.data.x.names ? quoted(this.data.x.names[i]) : Number(position(s, i).toPrecision(9));
        rows.push([quoted(s.label), x, written(y), s.low?.[i] ?? "", s.high?.[i] ?? ""]);
      });
    return rows.map((row) => row.join(separator)).join("\n");
  },
};
Object.assign(Chart.prototype, saving);
