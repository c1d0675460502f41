// Reads files as the page does, and tells what it found: node page_reading.mjs SCRIPTS DATA ASKED, of which ASKED holds a
// list of files, each with what a person answers: role to name of column, or time_format.
import { readFileSync } from "node:fs";
import path from "node:path";
import vm from "node:vm";

const [scripts, data, asked] = process.argv.slice(2);
for (const script of JSON.parse(scripts)) vm.runInThisContext(readFileSync(script, "utf8"), { filename: script });
globalThis.data = JSON.parse(readFileSync(data, "utf8"));
const reading = vm.runInThisContext("Reading(data)");
const plain = (column) => column && Array.from(column, (value) => (Number.isNaN(value) ? null : value));
const options = ({ names }, { columns = {}, ...more }) => ({ ...more, columns: Object.fromEntries(Object.entries(columns).map(([role, name]) => [role, names.indexOf(name)])) });
for (const [name, answer] of JSON.parse(readFileSync(asked, "utf8"))) {
  let found;
  try {
    const stem = path.basename(name).replace(/\..*$/, "");
    const file = await reading.open(new Uint8Array(readFileSync(name)), stem);
    const { columns, ...more } = reading.recording(file, options(file.loops[0], answer));
    found = { rows: reading.firstRows(file.loops[0], 2), columns: Object.fromEntries(Object.entries(columns).map(([of, column]) => [of, plain(column)])), ...more };
  } catch (wrong) {
    found = { wrong: wrong.message, stack: wrong.stack };
  }
  console.log(JSON.stringify(found));
}
