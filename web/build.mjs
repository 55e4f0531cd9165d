// Bundles the page into dist/, which the server carries: `node build.mjs`.
// `node build.mjs tests` bundles the tests into build/ instead, for Node to run.

import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";

import { build } from "esbuild";

const web = import.meta.dirname;
const dist = path.join(web, "dist");
const common = { absWorkingDir: web, bundle: true, format: "esm", target: "es2022", logLevel: "warning" };

/** Only what has changed is written, so that cargo does not compile for nothing. */
async function writeChanged(file, contents) {
  const before = await readFile(file).catch(() => null);
  if (!before?.equals(contents)) await writeFile(file, contents);
}

async function page() {
  const { outputFiles, metafile } = await build({
    ...common,
    entryPoints: { main: "src/page/main.ts", style: "src/style.css" },
    outdir: "dist",
    // What is imported on demand is a file of its own. Its name changes with it: a page that is open while the server is
    // replaced never gets a part of another version.
    splitting: true,
    chunkNames: "[name]-[hash]",
    minify: true,
    write: false,
    metafile: true,
  });
  const files = new Map(outputFiles.map(({ path: file, contents }) => [path.basename(file), Buffer.from(contents)]));
  files.set("index.html", Buffer.from(await document(firstScripts(metafile.outputs))));
  for (const words of ["words.en.json", "words.pt-BR.json"]) {
    files.set(words, Buffer.from(JSON.stringify(JSON.parse(await readFile(path.join(web, "src", words), "utf8")))));
  }
  files.set("shaders.json", Buffer.from(JSON.stringify(await shaders())));
  await mkdir(dist, { recursive: true });
  for (const [name, contents] of files) await writeChanged(path.join(dist, name), contents);
  for (const name of await readdir(dist)) if (!files.has(name)) await rm(path.join(dist, name));
}

/** The scripts that the first one cannot do without. */
function firstScripts(outputs) {
  const first = new Set();
  const visit = (file) => {
    for (const { path: imported, kind } of outputs[file].imports) {
      if (kind !== "import-statement" || first.has(imported)) continue;
      first.add(imported);
      visit(imported);
    }
  };
  visit("dist/main.js");
  return [...first].map((file) => path.basename(file));
}

/** The page's document, which asks for all first scripts at once. */
async function document(scripts) {
  const text = await readFile(path.join(web, "src/index.html"), "utf8");
  const links = scripts.map((name) => `  <link rel="modulepreload" href="./${name}">\n`).join("");
  return text.replace("</head>", `${links}</head>`);
}

/** The shaders' texts by name, without what only people read, and the tables of the colours. */
async function shaders() {
  const names = (await readdir(path.join(web, "shaders"))).filter((name) => name.endsWith(".glsl")).sort();
  const texts = names.map(async (name) => [
    name,
    (await readFile(path.join(web, "shaders", name), "utf8")).replace(/\n\s*/g, "\n").trim(),
  ]);
  const colors = JSON.parse(await readFile(path.join(web, "shaders/colors.json"), "utf8"));
  return { shaders: Object.fromEntries(await Promise.all(texts)), colors };
}

const filesBelow = async (folder) =>
  (await readdir(path.join(web, folder)))
    .filter((name) => /\.(ts|js|mjs)$/.test(name))
    .map((name) => path.join(folder, name));

/** Unit tests with what they test in one file each; tests in the browser import nothing of the page. */
async function tests() {
  await rm(path.join(web, "build"), { recursive: true, force: true });
  const forNode = {
    ...common,
    platform: "node",
    packages: "external",
    sourcemap: "inline",
    outExtension: { ".js": ".mjs" },
  };
  await build({ ...forNode, entryPoints: await filesBelow("test"), outdir: "build/test" });
  await build({ ...forNode, entryPoints: await filesBelow("../tests/browser"), outdir: "build/browser" });
}

await (process.argv[2] === "tests" ? tests() : page());
