// Pictures: uPlot for what goes over an axis, SVG for the gap itself. Colours come from the page's style.
"use strict";

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** Least and greatest of every so many rows, so that no peak is lost: times and values, two for each bucket. */
function thinned(t, columns, most = 4000) {
  const n = t.length;
  const width = Math.max(1, Math.ceil((2 * n) / most));
  if (width < 3) return [t, ...columns].map((column) => Array.from(column, (v) => (Number.isFinite(v) ? v : null)));
  const out = [[], ...columns.map(() => [])];
  for (let from = 0; from < n; from += width) {
    const to = Math.min(n, from + width);
    out[0].push(t[from], t[Math.floor((from + to - 1) / 2)]);
    columns.forEach((column, i) => {
      let [low, high] = [Infinity, -Infinity];
      for (let k = from; k < to; k += 1) {
        if (column[k] < low) low = column[k];
        if (column[k] > high) high = column[k];
      }
      out[i + 1].push(low === Infinity ? null : low, high === -Infinity ? null : high);
    });
  }
  return out;
}

/** The page's typeface; a picture on a canvas inherits none. */
const font = () => `12px ${getComputedStyle(document.body).fontFamily}`;

const axis = (label, more = {}) => ({
  label,
  stroke: () => colour("muted"),
  grid: { stroke: () => colour("faint"), width: 1 },
  ticks: { show: false },
  labelSize: 18,
  labelGap: 0,
  font: font(),
  labelFont: font(),
  ...more,
});

/** Labels of a time axis: hours and minutes, and the date below the first label and below each new day. */
function clock_of(plot, splits, _, __, step) {
  let day = "";
  return splits.map((s) => {
    const [date, time] = new Date(1000 * s).toISOString().split("T");
    const shown = step >= 86_400 ? "" : time.slice(0, step < 60 ? 8 : 5);
    const label = date === day ? shown : `${shown}\n${date}`;
    day = date;
    return label.trimStart();
  });
}

/**
 * A chart of lines over x. `lines`: label, colour's name, width, dash. `bands`: drawn behind, as [from, to, colour].
 * `live`: the same, asked at each drawing. `t0`: ms of x = 0 where x is a time; null: seconds; undefined: x is `x`.
 */
function chart(place, data, lines, { y, t0, x, height, bands, live, sync, limits, legend = true }) {
  const dated = t0 !== undefined && t0 !== null;
  const options = {
    width: place.clientWidth || 600,
    height,
    legend: { show: legend, live: false },
    cursor: { drag: { x: true, y: false }, ...(sync ? { sync: { key: sync } } : {}) },
    // Times of the recording are told as its own clock told them, wherever the page is read.
    // On the right there is room for half of a date.
    ...(dated ? { tzDate: (s) => uPlot.tzDate(new Date(s * 1000), "Etc/UTC"), padding: [null, 38, null, null] } : {}),
    scales: { x: { time: dated }, y: limits ? { range: limits } : {} },
    axes: [axis(dated ? null : t0 === null ? "time [s]" : x, dated ? { labelSize: 0, values: clock_of } : {}), axis(y, { size: 62 })],
    series: [
      { label: dated ? "time" : "x" },
      ...lines.map(({ label, stroke, width = 1.4, dash, points = false }) => ({
        label, dash, width: points ? 0 : width, stroke: () => colour(stroke), points: { show: points, size: 7, fill: () => colour(stroke) },
      })),
    ],
    hooks: bands || live ? { drawClear: [(u) => shade(u, live ? live() : bands)] } : {},
  };
  const scaled = dated ? [data[0].map((t) => t + t0 / 1000), ...data.slice(1)] : data;
  const plot = new uPlot(options, scaled, place);
  plots.add(plot);
  return plot;
}

function shade(u, bands) {
  const { ctx } = u;
  ctx.save();
  for (const [from, to, name] of bands) {
    const [left, right] = [from, to].map((at) => u.valToPos(at, "x", true));
    const [x0, x1] = [Math.max(left, u.bbox.left), Math.min(right, u.bbox.left + u.bbox.width)];
    if (x1 <= x0) continue;
    ctx.globalAlpha = 0.16;
    ctx.fillStyle = colour(name);
    ctx.fillRect(x0, u.bbox.top, x1 - x0, u.bbox.height);
  }
  ctx.restore();
}

/** All that are on the page: they follow its width and its colours. */
const plots = new Set();

function redraw() {
  for (const plot of plots) {
    if (!plot.root.isConnected) {
      plot.destroy();
      plots.delete(plot);
    } else if (plot.root.parentElement.clientWidth) {
      plot.setSize({ width: plot.root.parentElement.clientWidth, height: plot.height });
    }
  }
}
addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

const svg = (name, attributes, ...children) => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
};

const ticks = (low, high) => {
  const step = 10 ** Math.floor(Math.log10((high - low) / 3));
  const wide = [1, 2, 5, 10].map((m) => m * step).find((s) => (high - low) / s <= 5);
  const out = [];
  for (let v = Math.ceil(low / wide) * wide; v <= high; v += wide) out.push(Math.abs(v) < wide / 1e6 ? 0 : v);
  return out;
};

/** PV against OP as recorded, with the parallelogram that the fitted gap makes of a slow cycle, and its limits. */
function gapPicture(op, pv, shapes, { x, y, label }) {
  const [W, H, L, B] = [520, 420, 62, 46];
  const all = [op, pv].map((values, i) => values.concat(...shapes.map((shape) => shape.points.map((p) => p[i]))));
  const range = all.map((values) => {
    const finite = values.filter(Number.isFinite);
    const [low, high] = [finite.reduce((a, b) => Math.min(a, b)), finite.reduce((a, b) => Math.max(a, b))];
    const margin = 0.06 * (high - low) || 1;
    return [low - margin, high + margin];
  });
  const px = (v) => L + ((v - range[0][0]) / (range[0][1] - range[0][0])) * (W - L - 12);
  const py = (v) => H - B - ((v - range[1][0]) / (range[1][1] - range[1][0])) * (H - B - 12);
  const picture = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": label, class: "gap-picture" });
  for (const v of ticks(...range[0])) {
    picture.append(svg("path", { d: `M${px(v)},12V${H - B}`, class: "grid" }),
      svg("text", { x: px(v), y: H - B + 17, "text-anchor": "middle" }, number(v)));
  }
  for (const v of ticks(...range[1])) {
    picture.append(svg("path", { d: `M${L},${py(v)}H${W - 12}`, class: "grid" }),
      svg("text", { x: L - 7, y: py(v) + 4, "text-anchor": "end" }, number(v)));
  }
  const dots = op.map((u, i) => (Number.isFinite(u) && Number.isFinite(pv[i]) ? `M${px(u).toFixed(1)},${py(pv[i]).toFixed(1)}h0` : ""));
  picture.append(svg("path", { d: dots.join(""), class: "dots" }));
  for (const { points, kind } of shapes) {
    picture.append(svg("path", { d: `M${points.map(([u, v]) => `${px(u).toFixed(1)},${py(v).toFixed(1)}`).join("L")}`, class: kind }));
  }
  picture.append(svg("text", { x: (L + W) / 2, y: H - 8, "text-anchor": "middle" }, x),
    svg("text", { x: 14, y: H / 2 - B / 2, transform: `rotate(-90 14 ${H / 2 - B / 2})`, "text-anchor": "middle" }, y));
  return picture;
}
