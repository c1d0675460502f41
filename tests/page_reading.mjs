// Reads files as the page does, and tells what it found: node page_reading.mjs SCRIPTS DATA FILE...
import { readFileSync } from "node:fs";
import vm from "node:vm";

const [scripts, data, ...files] = process.argv.slice(2);
const context = vm.createContext({ TextDecoder, console });
for (const path of JSON.parse(scripts)) vm.runInContext(readFileSync(path, "utf8"), context, { filename: path });
context.data = JSON.parse(readFileSync(data, "utf8"));
const reading = vm.runInContext("Reading(data)", context);
const plain = (column) => column && Array.from(column, (value) => (Number.isNaN(value) ? null : value));
for (const path of files) {
  let told;
  try {
    const file = reading.open(new Uint8Array(readFileSync(path)));
    const { columns, chosen, t0, units } = reading.recording(file);
    const found = Object.fromEntries(Object.entries(columns).map(([name, column]) => [name, plain(column)]));
    told = { columns: found, chosen: Object.fromEntries(Object.entries(chosen).map(([role, at]) => [role, file.names[at]])), t0, units };
  } catch (wrong) {
    told = { wrong: wrong.message };
  }
  console.log(JSON.stringify(told));
}
