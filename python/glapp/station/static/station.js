// New points at the end of a chart's lines, old ones off its beginning: no more goes over the network than is new.
// A chart is drawn a few times a second at most, however fast they come: else the page has no time for the person.
window.glapp = {
  every: 200,
  waiting: {},
  append(id, points, keep) {
    const one = (glapp.waiting[id] ??= { points: [], drawn: -Infinity });
    one.points.push(...points);
    const rest = one.drawn + glapp.every - performance.now();
    if (rest <= 0) glapp.draw(id, keep);
    else one.timer ??= setTimeout(() => glapp.draw(id, keep), rest);
  },
  draw(id, keep) {
    const one = glapp.waiting[id];
    const points = one.points.splice(0);
    clearTimeout(one.timer);
    [one.timer, one.drawn] = [undefined, performance.now()];
    const chart = getElement(id)?.chart;
    if (!chart || !points.length) return;
    const from = points[points.length - 1][0] - keep;
    const series = chart.getOption().series.map((one, i) => {
      const data = one.data || [];
      const last = data.length ? data[data.length - 1][0] : -Infinity;
      const more = points.filter((p) => p[0] > last && p[i + 1] != null).map((p) => [p[0], p[i + 1]]);
      return { data: data.concat(more).filter((p) => p[0] >= from) };
    });
    chart.setOption({ series });
  },
  // Name of a half-period's reason; on a telephone they would lie on each other.
  reason: (area) => (innerWidth > 640 ? area.name : ""),
  // Half-periods behind PV, the second line.
  shade(id, areas) {
    for (const [{ label }] of areas) label.formatter = glapp.reason;
    getElement(id)?.chart?.setOption({ series: [{}, { markArea: { data: areas } }] });
  },
  // Urgency, with a shape for a person who does not see the colour.
  soon: ({ urgency, soon }) =>
    `${{ high: "▲", signal: "■", medium: "◆", low: "◇", none: "○", unjudged: "?" }[urgency]} ${soon}`,
  // On a telephone a loop is a card: its answer, urgency and next step, below each other.
  card({ data }) {
    const card = document.createElement("div");
    for (const [text, style] of [
      [[data.verdict, data.width].filter(Boolean).join(", "), "card-answer"],
      [glapp.soon(data), `soon-${data.urgency}`],
      [data.todo, "muted"],
    ]) {
      const line = card.appendChild(document.createElement("div"));
      line.textContent = text;
      line.className = style;
    }
    return card;
  },
  event({ data }) {
    const card = document.createElement("div");
    for (const [text, style] of [
      [[data.when, data.loop].filter(Boolean).join(", "), "card-answer"],
      [[data.kind, data.who].filter(Boolean).join(", "), "muted"],
      [data.text, ""],
    ]) {
      const line = card.appendChild(document.createElement("div"));
      line.textContent = text;
      line.className = style;
    }
    return card;
  },
  cards(grid, kept = []) {
    const narrow = matchMedia("(max-width: 640px)");
    const show = () => {
      if (grid.isDestroyed()) return;
      const all = grid.getColumns().map((one) => one.getColId());
      grid.setColumnsVisible(all.filter((id) => id !== "card" && !kept.includes(id)), !narrow.matches);
      grid.setColumnsVisible(["card"], narrow.matches);
    };
    narrow.addEventListener("change", show);
    show();
  },
  // The overview asks by itself: at first for all rows, then for those that have changed.
  overview(grid) {
    let version = 0;
    const look = async () => {
      const reply = await fetch(`/api/overview?since=${version}`).catch(() => null);
      if (reply?.ok) {
        const changes = await reply.json();
        const there = (loop) => grid.getRowNode(loop) !== undefined;
        if (changes.whole) grid.setGridOption("rowData", changes.loops);
        else if (changes.loops.length || changes.gone.length)
          grid.applyTransaction({
            add: changes.loops.filter((row) => !there(row.loop)),
            update: changes.loops.filter((row) => there(row.loop)),
            remove: changes.gone.filter(there).map((loop) => ({ loop })),
          });
        version = changes.version;
      }
      if (!grid.isDestroyed()) setTimeout(look, 2000);
    };
    look();
  },
  // Detections go to the chart as they are: the page's library would look at each point by itself.
  async detections(id, loop) {
    const [detected] = await Promise.all([
      fetch(`/api/loops/${encodeURIComponent(loop)}/detections`).then((reply) => reply.json()),
      (async () => {
        while (!getElement(id)?.chart) await new Promise(requestAnimationFrame);
      })(),
    ]);
    const scale = detected.percent ?? 1;
    const found = [[], [], []];
    detected.time.forEach((t, i) => {
      if (detected.width[i] !== null) found[detected.compensated[i]].push([1000 * t, scale * detected.width[i]]);
      if (detected.estimate[i] !== null) found[2].push([1000 * t, scale * detected.estimate[i]]);
    });
    getElement(id).chart.setOption({ series: found.map((data) => ({ data })) });
    getElement(id).$el.dataset.drawn = detected.time.length;
  },
  // Tab goes on from a list to what comes after it, or before it, and at the end to the beginning of the page.
  leave({ backwards }) {
    const list = document.activeElement.closest(".ag-root-wrapper");
    const all = document.querySelectorAll("a[href], button, input, select, textarea, [tabindex='0']");
    const others = [...all].filter((e) => !e.disabled && e.getClientRects().length && !list.contains(e));
    if (backwards) others.reverse();
    const side = backwards ? Node.DOCUMENT_POSITION_PRECEDING : Node.DOCUMENT_POSITION_FOLLOWING;
    const next = others.find((e) => list.compareDocumentPosition(e) & side) ?? others[0];
    setTimeout(() => next?.focus());
    return true;
  },
  // Where a part with the focus was built anew, it goes on to the first button there that can be pressed.
  refocus(id) {
    setTimeout(() => {
      const at = document.activeElement;
      if (at !== document.body && !at.matches(".q-dialog__inner")) return;
      document.getElementById(`c${id}`)?.querySelector("button:not([disabled])")?.focus();
    });
  },
  // Light or dark as the person's system is, until the person chooses.
  follow(dark, chosen) {
    if (chosen) return;
    const system = matchMedia("(prefers-color-scheme: dark)");
    const look = async () => {
      if (system.matches === dark) return;
      const reply = await fetch(`/theme?system=${system.matches ? "dark" : "light"}`, { method: "POST" });
      if (reply.ok) location.reload();
    };
    system.addEventListener("change", look);
    look();
  },
  // The login is over. After the next one the person is at the same loop again.
  expired() {
    const loop = location.pathname === "/loop" ? new URLSearchParams(location.search).get("name") : "";
    location.href = `/login?${new URLSearchParams({ why: "expired", loop: loop ?? "" })}`;
  },
  // Words have the times of the service's computer, pictures those of the browser: a person is told where they differ.
  zone(minutes) {
    if (-new Date().getTimezoneOffset() !== minutes) document.documentElement.dataset.zone = "other";
  },
  async post(path, then) {
    const reply = await fetch(path, { method: "POST" });
    if (reply.ok || reply.redirected) location.href = then;
  },
};
// The service tells a page by its socket that the login is over; a page that has none at that moment asks.
setInterval(async () => {
  const reply = await fetch("/who", { redirect: "manual" }).catch(() => null);
  if (reply?.type === "opaqueredirect") glapp.expired();
}, 2000);
