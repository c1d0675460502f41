// The windows of a fit, each by itself in a worker, as many at once as there are processors.
"use strict";

class Windows {
  workers = [];

  /** `joiner`: the worker that joins the results; `hear.done` gets how many are fitted, `hear.broke` why a worker
   * broke off. */
  constructor(module, windows, joiner, hear) {
    const alone = windows.map(() => null);
    let [next, done] = [0, 0];
    const give = (helper) => {
      if (next === windows.length) return;
      helper.postMessage({ kind: "alone", module, window: windows[next], place: next });
      next += 1;
    };
    for (let k = 0; k < Math.min(windows.length, navigator.hardwareConcurrency ?? 1); k += 1) {
      const helper = new Worker(worker_address);
      this.workers.push(helper);
      helper.onerror = (event) => hear.broke(event.message || "one of its workers died");
      helper.onmessage = ({ data: reply }) => {
        if (!this.workers.includes(helper)) return;
        if (reply.kind === "wrong") {
          hear.broke(reply.text);
          return;
        }
        alone[reply.place] = reply.alone;
        done += 1;
        give(helper);
        hear.done?.(done);
        if (done === windows.length) joiner.postMessage({ kind: "join", alone });
        // After 1, 2, 4 … windows what they say so far is joined, and told.
        else if ((done & (done - 1)) === 0) joiner.postMessage({ kind: "join", alone, so_far: done });
      };
      give(helper);
    }
  }

  end() {
    for (const helper of this.workers) helper.terminate();
    this.workers = [];
  }
}
