// Bundles the page into dist/, which the server carries: `node build.mjs`.
// `node build.mjs tests` bundles the tests into build/ instead, for Node to run.

import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";

import { build } from "esbuild";

const web = import.meta.dirname;
const common = { absWorkingDir: web, bundle: true, format: "esm", target: "es2022", logLevel: "warning" };

/** Only what has changed is written, so that cargo does not compile for nothing. */
async function writeChanged(file, contents) {
  const before = await readFile(file).catch(() => null);
  if (!before?.equals(contents)) await writeFile(file, contents);
}

async function page() {
  const { outputFiles } = await build({
    ...common,
    entryPoints: { main: "src/page/main.ts", style: "src/style.css" },
    outdir: "dist",
    minify: true,
    write: false,
  });
  await mkdir(path.join(web, "dist"), { recursive: true });
  for (const { path: file, contents } of outputFiles) await writeChanged(file, Buffer.from(contents));
  await writeChanged(path.join(web, "dist/index.html"), await readFile(path.join(web, "src/index.html")));
  for (const words of ["words.en.json", "words.pt-BR.json"]) {
    const compact = JSON.stringify(JSON.parse(await readFile(path.join(web, "src", words), "utf8")));
    await writeChanged(path.join(web, "dist", words), Buffer.from(compact));
  }
  await writeChanged(path.join(web, "dist/shaders.json"), Buffer.from(JSON.stringify(await shaders())));
}

/** The shaders' texts by name, without what only people read. */
async function shaders() {
  const names = (await readdir(path.join(web, "shaders"))).filter((name) => name.endsWith(".glsl")).sort();
  const texts = names.map(async (name) => [
    name,
    (await readFile(path.join(web, "shaders", name), "utf8")).replace(/\n\s*/g, "\n").trim(),
  ]);
  return Object.fromEntries(await Promise.all(texts));
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
