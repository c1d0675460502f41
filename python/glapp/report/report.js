// Draws each figure when it comes near the view, in the colours of the page.
(() => {
  "use strict";
  const read = (id) => document.getElementById(id).textContent;
  const swap = JSON.parse(read("dark"));
  const config = JSON.parse(read("config"));
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  const plots = [...document.querySelectorAll(".plot")];
  const PAPER = 680; // px between the margins of an A4 or Letter page
  const NARROW = 480; // px: narrower pages need more rows for a legend under its picture
  const low = (plot) => (plot.dataset.name === "time" ? 380 : 250); // px: a loop on one page; report.css has the same
  let printing = false;

  function figure(plot) {
    let text = read("data-" + plot.dataset.key);
    if (scheme.matches && !printing) text = text.replace(/#[0-9a-f]{6}/g, (colour) => swap[colour] ?? colour);
    const { arrays, figures } = JSON.parse(text);
    const restore = (node) => {
      if (Array.isArray(node)) return node.map(restore);
      if (node === null || typeof node !== "object") return node;
      if ("$" in node) return { ...arrays[node.$] };
      return Object.fromEntries(Object.entries(node).map(([key, value]) => [key, restore(value)]));
    };
    return restore(figures[plot.dataset.name]);
  }

  function draw(plot) {
    const { data, layout } = figure(plot);
    if (printing) {
      layout.width = Math.min(PAPER, plot.clientWidth);
      if (plot.closest(".believed")) layout.height = low(plot);
    }
    const narrow = !printing && plot.clientWidth < NARROW;
    if (narrow) {
      const names = data.filter(({ legend }) => legend === "legend2").length;
      // A row holds one name of the half-periods in place of three, and two of the parallelogram's three names.
      const more = plot.dataset.name === "gap" ? 28 : 20 * (names - Math.ceil(names / 3));
      layout.height += more;
      layout.margin.b += more;
      plot.style.height = `${layout.height}px`;
    }
    // On a narrow page the buttons would lie on the legend.
    Plotly.react(plot, data, layout, narrow ? { ...config, displayModeBar: false } : config);
    plot.dataset.drawn = "";
  }

  // A few loops are read one after the other, many are looked up.
  const sections = document.querySelectorAll(".loop > details");
  if (sections.length < 6) sections.forEach((details) => (details.open = true));

  const watcher = new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) {
        if (isIntersecting) {
          watcher.unobserve(target);
          draw(target);
        }
      }
    },
    { rootMargin: "400px" },
  );
  plots.forEach((plot) => watcher.observe(plot));

  const redraw = () => plots.filter((plot) => "drawn" in plot.dataset).forEach(draw);
  scheme.addEventListener("change", redraw);
  addEventListener("beforeprint", () => {
    printing = true;
    document.querySelectorAll(".unjudged").forEach((details) => (details.open = true));
    plots.filter((plot) => plot.offsetParent !== null).forEach(draw);
  });
  addEventListener("afterprint", () => {
    printing = false;
    redraw();
  });

  // A link to a loop opens its section.
  function open() {
    const details = document.getElementById(location.hash.slice(1))?.querySelector(":scope > details");
    if (details) {
      details.open = true;
      details.scrollIntoView();
    }
  }
  addEventListener("hashchange", open);
  open();
})();
