// Writes numbers as the page does: node page_words.mjs SCRIPT ASKED
import { readFileSync } from "node:fs";
import vm from "node:vm";

const [script, asked] = process.argv.slice(2);
const context = vm.createContext({});
vm.runInContext(readFileSync(script, "utf8"), context, { filename: script });
for (const [name, ...given] of JSON.parse(readFileSync(asked, "utf8"))) {
  context.given = given;
  console.log(JSON.stringify(vm.runInContext(`${name}(...given)`, context)));
}
