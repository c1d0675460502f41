// The other side of crates/page: numbers into its memory, requests and answers as JSON.
"use strict";

class Engine {
  constructor(instance) {
    this.exports = instance.exports;
  }

  static async of(module) {
    return new Engine(await WebAssembly.instantiate(module, {}));
  }

  #say(text) {
    const bytes = new TextEncoder().encode(text);
    const at = this.exports.text(bytes.length);
    new Uint8Array(this.exports.memory.buffer, at, bytes.length).set(bytes);
  }

  /** Copies a column of numbers into the core's memory, under a name. */
  column(name, numbers) {
    this.#say(name);
    const at = this.exports.room(numbers.length);
    new Float64Array(this.exports.memory.buffer, at, numbers.length).set(numbers);
  }

  /** Asks; throws the error in the words of the core. */
  ask(what, more = null) {
    this.#say(JSON.stringify({ [what]: more }));
    const length = this.exports.ask();
    const reply = JSON.parse(new TextDecoder().decode(new Uint8Array(this.exports.memory.buffer, this.exports.answered(), length)));
    if (reply.error !== undefined) throw new Error(reply.error);
    return reply.ok;
  }
}

/** Reader of an answer's sentences: the loop, units, and local date and time of the first row [µs since 1970]. */
const reader_of = ({ read, unit }) => ({ name: read.loop, pv_unit: read.units.pv ?? "PV unit", op_unit: unit, t0: read.t0 === null ? null : Math.round(1000 * read.t0) });
