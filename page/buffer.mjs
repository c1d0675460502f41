// Part of node's Buffer that seek-bzip needs.
export class Buffer extends Uint8Array {
  copy(target, at = 0, from = 0, to = this.length) {
    target.set(this.subarray(from, to), at);
  }

  toString(how) {
    return how === "hex" ? Array.from(this, (byte) => byte.toString(16).padStart(2, "0")).join("") : new TextDecoder().decode(this);
  }
}
