// New points at the end of a chart's lines, old ones off its beginning: no more goes over the network than is new.
window.glapp = {
  append(id, points, keep) {
    const chart = getElement(id)?.chart;
    if (!chart || !points.length) return;
    const from = points[points.length - 1][0] - keep;
    const series = chart.getOption().series.map((one, i) => {
      const data = one.data || [];
      const last = data.length ? data[data.length - 1][0] : -Infinity;
      const more = points.filter((p) => p[0] > last && p[i + 1] !== null).map((p) => [p[0], p[i + 1]]);
      return { data: data.filter((p) => p[0] >= from).concat(more) };
    });
    chart.setOption({ series });
  },
  async post(path, then) {
    const reply = await fetch(path, { method: "POST" });
    if (reply.ok || reply.redirected) location.href = then;
  },
};
// The service tells a page by its socket that the login is over; a page that has none at that moment asks.
setInterval(async () => {
  const reply = await fetch("/who", { redirect: "manual" }).catch(() => null);
  if (reply?.type === "opaqueredirect") location.href = "/login?why=expired";
}, 2000);
