// The laboratory: a loop of modules that runs here, picture by picture.
"use strict";

const Laboratory = (() => {
  const { project, knobs, most_at_once: AT_ONCE, kept: KEPT, fastest: FASTEST } = data.laboratory;
  const RECORDED = ["sp.out", "noise.out", "pid.out", "stick.out", "watch.d_hat", "watch.delta_t", "watch.last_delta_t", "watch.d", "watch.reason"];
  const AHEAD = 1000; // s that are simulated before the first picture, so that it has an estimate
  const BUDGET = 6; // ms of a picture's 16.7 that drawing may take before it waits for the next
  const [SP, PV, OP, VALVE, D_HAT, DELTA_T, LAST_DELTA_T, D, REASON] = RECORDED.keys();
  let engine = null;
  let paths = [];
  let editable = [];
  let t = [];
  let columns = [];
  let halves = [];
  let scans = 0;
  let due = 0;
  let last = null;
  let running = true;
  let shown = false;
  let charts = null;
  let pictures = [];
  let shown_at = 0;
  let late = new Set(); // charts that show less than there is

  const wrong = (text) => {
    $("lab-wrong").textContent = text;
    $("lab-wrong").hidden = !text;
  };

  function anew() {
    ({ paths, editable } = engine.ask("laboratory", project));
    [t, columns, halves, scans, due] = [[], RECORDED.map(() => []), [], 0, 0];
    end_fit("");
    $("lab-compensate").checked = false;
    fields();
    controls();
    wrong("");
  }

  /** Simulates some time at once. */
  function ahead(seconds) {
    for (let left = Math.round(seconds / project.h); left > 0; left -= AT_ONCE) scan(Math.min(left, AT_ONCE));
    late = new Set(charts);
  }

  /** Sets variables; all of a knob together, as the tuning of controller and detector. */
  function set(names, value) {
    try {
      for (const path of names) engine.ask("set", { path, value });
      wrong("");
    } catch (error) {
      wrong(error.message);
    }
    values();
  }

  function controls() {
    const now = Object.fromEntries(engine.ask("values").map((value, i) => [paths[i], value]));
    $("lab-knobs").replaceChildren(...knobs.map(({ label, paths: of, low, high, step }) => {
      const out = h("output", {}, number(now[of[0]]));
      const slider = h("input", { type: "range", min: low, max: high, step, value: now[of[0]], oninput: (event) => {
        out.textContent = number(Number(event.target.value));
        set(of, Number(event.target.value));
      } });
      slider.value = now[of[0]];
      return h("label", {}, h("span", {}, label), slider, out);
    }));
  }

  // --- time

  function picture(now) {
    if (shown) {
      const elapsed = last === null ? 0 : Math.min(0.25, (now - last) / 1000);
      pictures.push(now);
      while (pictures[0] < now - 1000) pictures.shift();
      if (running && advance(elapsed)) late = new Set(charts);
      draw(now);
      if (now - shown_at > 250) {
        shown_at = now;
        tell();
      }
    }
    last = shown ? now : null;
    requestAnimationFrame(picture);
  }

  function advance(elapsed) {
    due += (elapsed * speed()) / project.h;
    const n = Math.min(Math.floor(due + 1e-9), AT_ONCE);
    if (n < 1) return false;
    due = Math.min(due - n, AT_ONCE); // what cannot be made is given up
    scan(n);
    return true;
  }

  function scan(n) {
    const found = engine.ask("run", { scans: n, record: RECORDED });
    for (let k = 0; k < n; k += 1) {
      scans += 1;
      t.push(scans * project.h);
      found.forEach((column, i) => columns[i].push(column[k]));
      const at = t.length - 1;
      if (at > 0 && columns[DELTA_T][at] < columns[DELTA_T][at - 1]) {
        const [length, d, reason] = [LAST_DELTA_T, D, REASON].map((i) => columns[i][at]);
        halves.push({ from: t[at] - length, to: t[at], length, d, reason: data.names[reason] });
      }
    }
    if (t.length > 1.25 * KEPT) {
      t = t.slice(-KEPT);
      columns = columns.map((column) => column.slice(-KEPT));
      halves = halves.filter((half) => half.to > t[0]);
    }
  }

  const speed = () => Math.min(Math.max(Number($("lab-speed").value) || 1, 0.1), FASTEST);

  // --- what is seen

  function window_of() {
    const seconds = Number($("lab-window").value);
    const from = (t.at(-1) ?? 0) - seconds;
    const first = Math.max(0, t.length - Math.ceil(seconds / project.h));
    return { range: [from, Math.max(t.at(-1) ?? 0, from + seconds)], first };
  }

  function bands() {
    const { range } = window_of();
    return halves.filter((half) => half.to > range[0]).map((half) => [half.from, half.to, `r-${half.reason}`]);
  }

  function build() {
    const none = (n) => Array.from({ length: n }, () => []);
    const drawn = (id, lines, y, height, more = {}) => chart($(id), none(lines.length + 1), lines, { y, t0: null, height, ...more });
    charts = [
      [drawn("lab-pv", [{ label: "PV", stroke: "raw", width: 1 }, { label: "SP", stroke: "ink", dash: [6, 3] }], "SP, PV [%]", 250, { live: bands }), [PV, SP]],
      [drawn("lab-op", [{ label: "valve", stroke: "position", width: 2.4 }, { label: "OP", stroke: "output" }], "OP, valve [%]", 220), [VALVE, OP]],
      [drawn("lab-d", [{ label: "estimate", stroke: "estimate", width: 2 }, { label: "detection", points: true, stroke: "gap-tone" }], "width [%OP]", 170), null],
    ];
  }

  /** Draws new parts, in turns: where a machine cannot draw all within one picture, the rest is drawn in the next. */
  function draw(began) {
    if (!t.length || !late.size) return;
    const { range, first } = window_of();
    const times = t.slice(first);
    for (const waiting of late) {
      const [plot, which] = waiting;
      late.delete(waiting);
      let drawn;
      if (which) drawn = thinned(times, which.map((i) => columns[i].slice(first)), 2400);
      else {
        const accepted = halves.filter((half) => half.reason === "accepted" && half.to > range[0]);
        drawn = thinned(times, [columns[D_HAT].slice(first).map((v) => v ?? NaN)], 2400);
        // A detection stands at its own time: the two lines are joined over all times.
        const all = uPlot.join([[drawn[0], drawn[1]], [accepted.map((half) => half.to), accepted.map((half) => half.d)]]);
        drawn = all;
      }
      plot.batch(() => {
        plot.setData(drawn, true);
        plot.setScale("x", { min: range[0], max: range[1] });
      });
      if (performance.now() - began > BUDGET) break;
    }
  }

  function tell() {
    const rate = pictures.length;
    $("laboratory").dataset.pictures = String(rate);
    $("laboratory").dataset.t = String(t.at(-1) ?? 0);
    $("lab-state").textContent = `t = ${Math.round(t.at(-1) ?? 0)} s at ${number(speed())} ×`;
    const now = values();
    const rows = [["Estimate", quantity(now["watch.d_hat"], "%OP")], ["Detections", number(now["watch.detections"])],
      ["Half-periods", String(halves.length)], ["u_FF", quantity(now["watch.u_ff"], "%OP")],
      ["Compensation", data.laboratory.standings[now["watch.standing"]] ?? DASH]];
    $("lab-facts").replaceChildren(...facts(rows).children);
    $("lab-halves").replaceChildren(...halves.slice(-6).reverse().map((half) => h("tr", {}, h("td", { "data-label": "Ended" }, `${Math.round(half.to)} s`),
      h("td", { "data-label": "Δt", class: "n" }, quantity(half.length, "s")), h("td", { "data-label": "Width", class: "n" }, half.reason === "accepted" ? quantity(half.d, "%OP") : DASH),
      h("td", { "data-label": "Verdict" }, h("span", { title: words.reasons[half.reason].meaning }, swatch(half.reason))))));
  }

  // --- every variable

  let inputs = [];

  function fields() {
    inputs = paths.map((path, i) => (editable[i]
      ? h("input", { "aria-label": path, inputmode: "decimal", onchange: (event) => edited(path, event.target) })
      : h("output", { "aria-label": path })));
    $("lab-variables").replaceChildren(...paths.map((path, i) => h("label", { "data-path": path }, h("span", {}, path), inputs[i])));
    search();
  }

  function edited(path, field) {
    const text = field.value.trim().replace("−", "-").replace(",", ".");
    const value = text === "" || text === DASH ? null : Number(text);
    if (Number.isNaN(value)) wrong(`${path}: '${text}' is not a number`);
    else set([path], value);
    field.blur();
    controls();
  }

  function values() {
    const found = engine.ask("values");
    if ($("lab-all").open) {
      found.forEach((value, i) => {
        const text = number(value !== null && Math.abs(value) > 1e300 ? null : value, 5);
        if (editable[i]) {
          if (document.activeElement !== inputs[i]) inputs[i].value = text;
        } else inputs[i].textContent = text;
      });
    }
    return Object.fromEntries(found.map((value, i) => [paths[i], value]));
  }

  function search() {
    const wanted = $("lab-search").value.trim().toLowerCase();
    for (const label of $("lab-variables").children) label.hidden = !label.dataset.path.toLowerCase().includes(wanted);
  }

  // --- the fit

  let fitter = null;
  let fitting = null;

  function end_fit(text) {
    fitter?.terminate();
    fitting?.end();
    [fitter, fitting] = [null, null];
    $("lab-fit").textContent = "Fit what is recorded";
    $("lab-fitted").textContent = text;
  }

  async function fit() {
    const started = new Worker(worker_address);
    fitter = started;
    $("lab-fit").textContent = "End the fit";
    const [began, now] = [performance.now(), values()];
    const columns_of = { t, sp: columns[SP], pv: columns[PV], op: columns[OP] };
    const stage = `Fitting the last ${duration(Math.round(t.at(-1) - t[0]))} …`;
    $("lab-fitted").textContent = stage;
    const module = await module_ready;
    const sentence_of = (reply) => {
      const { answer } = reply.answer;
      const { headline, so } = reply.texts.parts;
      const gap = quantity(now["gap.d"], "%OP");
      return headline ? `${verdict(answer)} ${headline}; the true gap is ${gap}.` : `${so} The true gap is ${gap}.`;
    };
    const hears = {
      ready() {},
      windows({ windows }) {
        if (windows.length > 1) $("lab-fitted").textContent = `${stage} 0 of ${windows.length} windows`;
        fitting = new Windows(module, windows, started, { broke: (reason) => end_fit(`The fit broke off (${reason}).`) });
      },
      so_far(reply) {
        $("lab-fitted").textContent = `${stage} ${reply.windows} of ${reply.of} windows so far: ${sentence_of(reply)}`;
      },
      answered(reply) {
        end_fit(`${sentence_of(reply)} ${number((performance.now() - began) / 1000, 2)} s`);
      },
      wrong: ({ text }) => end_fit(text),
    };
    started.onmessage = ({ data: reply }) => started === fitter && hears[reply.kind](reply);
    started.onerror = (event) => started === fitter && end_fit(`The fit broke off (${event.message || "its worker died"}).`);
    started.postMessage({ kind: "begin", module, data: data.reading });
    const controller = { k: now["pid.k"], ti: now["pid.ti"], td: now["pid.td"], b: now["pid.b"] };
    started.postMessage({ kind: "fit", columns: columns_of, task: { controller, op_percent: true } });
  }

  /** Settings in a link behind #laboratory?, as gap.d=4&pid.k=1.5; the first that is refused ends it. */
  function set_from_link() {
    for (const [path, value] of new URLSearchParams(location.hash.split("?")[1] ?? "")) {
      set([path], Number(value));
      if (!$("lab-wrong").hidden) break;
    }
    controls();
  }

  // --- what the page calls

  $("lab-run").addEventListener("click", () => {
    running = !running;
    $("lab-run").textContent = running ? "Pause" : "Run";
  });
  for (const button of document.querySelectorAll("[data-speed]")) {
    button.addEventListener("click", () => { $("lab-speed").value = button.dataset.speed; });
  }
  $("lab-anew").addEventListener("click", anew);
  $("lab-compensate").addEventListener("change", (event) => set(["watch.compensate"], event.target.checked ? 1 : 0));
  $("lab-fit").addEventListener("click", () => (fitter ? end_fit("The fit was ended.") : fit()));
  $("lab-window").addEventListener("change", () => { late = new Set(charts); });
  $("lab-search").addEventListener("input", search);

  addEventListener("gone", async ({ detail }) => {
    shown = detail === "laboratory";
    if (!shown || engine) return;
    await words_ready;
    engine = await Engine.of(await module_ready);
    anew();
    set_from_link();
    build();
    ahead(AHEAD);
    requestAnimationFrame(picture);
  });
})();

if (location.hash.startsWith("#laboratory")) go("laboratory"); // a link into it
