// The page as a whole: its charts, copying, printing, contents, and theme.
document.documentElement.classList.add("scripted");
const charts = new Map();
for (const figure of document.querySelectorAll("figure.chart")) charts.set(figure, new Chart(figure));

for (const button of document.querySelectorAll("figure.still button.save"))
  button.addEventListener("click", () => {
    const figure = button.closest("figure");
    const title = figure.querySelector("h3").textContent;
    savePicture(title, button.dataset.format, new XMLSerializer().serializeToString(figure.querySelector(".plot svg")));
  });

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
    const box = button.closest("details, .table, .block");
    const all = button.dataset.copy === "points" && charts.get(button.closest("figure"));
    const table = box.querySelector("table");
    await copy(all ? all.numbers("\t") : table ? tableText(table) : box.querySelector("pre").textContent);
    const before = button.textContent;
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = before), 1500);
  });

// Paper cannot be opened: reasons and short tables are printed, whether they are open or not.
let closed = [];
addEventListener("beforeprint", () => {
  closed = [...document.querySelectorAll("details:not([open], .sampled, .more)")];
  for (const details of closed) details.open = true;
});
addEventListener("afterprint", () => {
  for (const details of closed) details.open = false;
});

// The contents show where the reader is.
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
const seen = new IntersectionObserver(
  (entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      for (const link of links.values()) link.removeAttribute("aria-current");
      links.get(entry.target.id)?.setAttribute("aria-current", "true");
    }
  },
  { rootMargin: "-20% 0px -75% 0px" },
);
for (const section of document.querySelectorAll("main > section")) seen.observe(section);

document.querySelector(".theme").addEventListener("click", () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});
