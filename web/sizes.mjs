// Prints what the page weighs, gzipped, beside what it weighed in sizes.json: `node sizes.mjs`, after `node build.mjs`.
// `node sizes.mjs record` writes sizes.json: after a growth of more than a tenth, with the reason in the commit message.
// It fails only where something large was bundled by mistake.

import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";

const web = import.meta.dirname;
const BASE = path.join(web, "sizes.json");
const MOST_BYTES = 200_000;

const { documents, hashed } = JSON.parse(await readFile(path.join(web, "dist/manifest.json"), "utf8"));
const size = async (name) => (await readFile(path.join(web, "dist", `${name}.gz`))).length;
const sum = async (names) => (await Promise.all(names.map(size))).reduce((before, one) => before + one, 0);
const first = documents.find(({ address }) => address === "/");
const sizes = {
  /** The document with all that it names, which is all of the page: the words of one language and the volume follow. */
  first_load: await sum([first.file, ...first.loads]),
  /** All documents, scripts, style sheets and words. */
  total: await sum([...documents.map(({ file }) => file), ...hashed.filter((name) => !name.endsWith(".map"))]),
  /** What a file to hand on holds besides its case. */
  shared_document: await size("share.html"),
};

if (process.argv[2] === "record") await writeFile(BASE, `${JSON.stringify(sizes, null, 2)}\n`);
const base = JSON.parse(await readFile(BASE, "utf8"));
for (const [name, bytes] of Object.entries(sizes)) {
  const growth = (100 * (bytes - base[name])) / base[name];
  const sign = growth < 0 ? "" : "+";
  console.log(`${name.replace("_", " ")}: ${bytes} bytes gzipped; base ${base[name]} (${sign}${growth.toFixed(1)} %)`);
}
if (sizes.total > MOST_BYTES) {
  console.error(`The page weighs more than ${MOST_BYTES} bytes: find what was bundled by mistake.`);
  process.exitCode = 1;
}
