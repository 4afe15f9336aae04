"""The figure of knn.py."""

import pathlib
from math import ceil, floor, log10

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666", "#8c5a2b")


def plot(path, curves):
    """Plots time against rows, both logarithmic, as SVG. `curves`: contender -> [(rows, seconds)]."""
    points = [point for curve in curves.values() for point in curve]
    if not points:
        raise SystemExit("nothing to plot: --plot wants plant data")
    x0, x1 = (log10(f(point[0] for point in points)) for f in (min, max))
    y0, y1 = floor(log10(min(point[1] for point in points))), ceil(log10(max(point[1] for point in points)))
    x0, x1, y1 = x0 - 0.05, max(x1, x0 + 0.3) + 0.05, max(y1, y0 + 1)
    left, top, width, height = 70, 20, 480, 360
    x = lambda rows: left + width * (log10(rows) - x0) / (x1 - x0)
    y = lambda seconds: top + height * (1 - (log10(seconds) - y0) / (y1 - y0))
    text = lambda at, up, words, more="": f'<text x="{at:.1f}" y="{up:.1f}" {more}>{words}</text>'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 440" font-family="sans-serif" font-size="12">',
        "<title>Time to build neighbour tables against the number of rows</title>",
        '<rect width="720" height="440" fill="#fff"/>',
        f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#999"/>',
    ]
    for power in range(y0, y1 + 1):
        parts.append(f'<path d="M{left} {y(10.0**power):.1f}h{width}" stroke="#ddd"/>')
        parts.append(text(left - 6, y(10.0**power) + 4, f"{10.0**power:g}", 'text-anchor="end"'))
    for rows in sorted({rows for rows, _ in points}):
        parts.append(f'<path d="M{x(rows):.1f} {top}v{height}" stroke="#eee"/>')
        label = f"{rows / 1e6:g}M" if rows >= 1e6 else f"{rows / 1e3:g}k"
        parts.append(text(x(rows), top + height + 18, label, 'text-anchor="middle"'))
    parts.append(text(left + width / 2, top + height + 40, "rows x 142 (simulated plant)", 'text-anchor="middle"'))
    parts.append(text(16, top + height / 2, "seconds", f'text-anchor="middle" transform="rotate(-90 16 {top + height / 2})"'))
    for index, (contender, curve) in enumerate(curves.items()):
        colour, curve = COLOURS[index % len(COLOURS)], sorted(curve)
        line = "L".join(f"{x(rows):.1f} {y(seconds):.1f}" for rows, seconds in curve)
        thick = 3 if contender == "calib" else 1.5
        parts.append(f'<path d="M{line}" fill="none" stroke="{colour}" stroke-width="{thick}"/>')
        parts += [f'<circle cx="{x(r):.1f}" cy="{y(s):.1f}" r="3" fill="{colour}"/>' for r, s in curve]
        up = top + 14 + 20 * index
        parts.append(f'<path d="M{left + width + 14} {up - 4}h20" stroke="{colour}" stroke-width="{thick}"/>')
        parts.append(text(left + width + 40, up, contender))
    pathlib.Path(path).write_text("\n".join([*parts, "</svg>"]) + "\n")
