// Charts are complete without this script; it adds reading, hiding, zooming, saving and copying.
const SVG = document.querySelector("svg")?.namespaceURI;
// Colours of pictures that leave the page; on the page itself the style sheet has the last word.
const PAPER = { ink: "#1b2733", muted: "#5b6875", grid: "#e3e8ed" };
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

// A series with its values as numbers: NaN where there is none, infinite where it diverged. Long ones come packed, at
// equal steps: 32-bit floats, or 16-bit numbers between the smallest and the largest value, of which the last is NaN.
const unpacked = (series) => {
  if (!series.packed) {
    const named = (v) => (v === null ? NaN : v === "diverged" ? Infinity : v);
    return { ...series, y: series.y.map(named) };
  }
  let y;
  const unpack = () => {
    const bytes = Uint8Array.from(atob(series.packed), (c) => c.charCodeAt(0));
    if (series.from === undefined) return new Float32Array(bytes.buffer);
    const scale = (series.to - series.from) / 65534;
    return Float32Array.from(new Uint16Array(bytes.buffer), (q) => (q === 65535 ? NaN : series.from + q * scale));
  };
  // Most charts are never touched: unpacking waits for the first who asks.
  return { label: series.label, side: series.side, step: series.step, dense: true, get y() { return (y ??= unpack()); } };
};
const position = (series, i) => (series.dense ? i * series.step : series.x[i]);
