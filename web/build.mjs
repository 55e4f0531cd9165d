// Bundles the page into dist/, which the server carries, and the widget into the Python package: `node build.mjs`.
// `node build.mjs tests` bundles the tests into build/ instead, for Node to run.

import { createHash } from "node:crypto";
import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { brotliCompress, gzip } from "node:zlib";

import { build } from "esbuild";

const web = import.meta.dirname;
const dist = path.join(web, "dist");
const common = {
  absWorkingDir: web,
  bundle: true,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  plugins: [{ name: "shaders", setup: (bundler) => bundler.onLoad({ filter: /\.glsl$/ }, shader) }],
  logLevel: "warning",
};

/** The text of a shader without the spaces that no compiler needs. */
async function shader({ path: file }) {
  const text = await readFile(file, "utf8");
  return { loader: "text", contents: text.replace(/^\s+/gm, "").replace(/ ?([*/=<>&|?:,;(){}]+) ?/g, "$1") };
}

/** The words of a language as they are bundled: the names, which all languages share, are in a module of their own. */
const words = {
  name: "words",
  setup(bundler) {
    bundler.onResolve({ filter: /^words-names$/ }, ({ path: name }) => ({ path: name, namespace: "words" }));
    bundler.onLoad({ filter: /.*/, namespace: "words" }, async () => {
      const names = Object.keys(JSON.parse(await readFile(path.join(web, "src/words.en.json"), "utf8")));
      return { loader: "json", contents: JSON.stringify(names) };
    });
    bundler.onLoad({ filter: /words\.[\w-]+\.json$/ }, async ({ path: file }) => {
      const texts = Object.values(JSON.parse(await readFile(file, "utf8")));
      const contents = `import names from "words-names";
        const texts = ${JSON.stringify(texts)};
        export default Object.fromEntries(names.map((name, at) => [name, texts[at]]));`;
      return { loader: "js", contents };
    });
  },
};

/** The documents: each has the head of `src/page.html`, the style sheet and the script; the first one has the icons. */
const DOCUMENTS = [
  {
    address: "/",
    file: "index.html",
    icons: true,
    class: "reading",
    description: "Curved cuts of the cortex at any depth.",
  },
  {
    address: "/compare",
    file: "compare.html",
    class: "comparing",
    description: "Two heads side by side, at one depth.",
  },
  { address: "/launch", file: "launch.html", class: "launching", description: "Opens the case of a study." },
];
const SCRIPT = "src/start/main.ts";
const STYLE = "src/style.css";
/** The document that the server fills with a case, to hand on. */
const SHARED = { file: "share.html", template: "src/share.html", entry: "src/share/main.tsx" };

/**
 * Writes into dist/ the documents, the scripts and the style sheet, each also as brotli and gzip, and `manifest.json`,
 * which lists them for the server. The names of scripts and style sheets change with their content, so that browsers may
 * keep them for ever, and a page that is open while the server is replaced never gets a part of another version.
 */
async function page() {
  const { outputFiles, metafile } = await build({
    ...common,
    plugins: [...common.plugins, words],
    entryPoints: [SCRIPT, STYLE],
    outdir: "dist",
    entryNames: "[name]-[hash]",
    chunkNames: "[name]-[hash]",
    splitting: true,
    minify: true,
    sourcemap: true,
    metafile: true,
    write: false,
  });
  const files = new Map(outputFiles.map((file) => [path.basename(file.path), Buffer.from(file.contents)]));
  const hashed = [...files.keys()].sort();
  const outputs = Object.entries(metafile.outputs);
  const outputOf = (entry) => outputs.find(([, { entryPoint }]) => entryPoint === entry)[0];
  const script = outputOf(SCRIPT);
  // The names come while the page finds out which language they are for.
  const early = [script, outputOf("src/words.en.json")].flatMap((one) => staticImports(metafile, one));
  const shapes = (await readFile(path.join(web, "src/icons.svg"), "utf8")).replace(/\n */g, "");
  const template = await readFile(path.join(web, "src/page.html"), "utf8");
  const documents = DOCUMENTS.map(({ address, file, icons, ...texts }) => {
    const values = {
      ...texts,
      icons: icons ? shapes : "",
      script: path.basename(script),
      style: path.basename(outputOf(STYLE)),
      preloads: early.map((chunk) => `<link rel="modulepreload" href="./${path.basename(chunk)}">`).join("\n  "),
    };
    files.set(file, Buffer.from(template.replace(/\{\{(\w+)\}\}/g, (_, name) => values[name])));
    return { address, file, loads: [values.style, values.script] };
  });
  files.set(
    SHARED.file,
    await shared(
      shapes,
      outputFiles.find(({ path: name }) => path.extname(name) === ".css"),
    ),
  );
  const manifest = JSON.stringify({ documents, hashed }, null, 2);
  await mkdir(dist, { recursive: true });
  for (const [name, contents] of files) await writeServed(name, contents);
  await writeChanged("manifest.json", Buffer.from(`${manifest}\n`));
  const kept = new Set(["manifest.json", ...[...files.keys()].flatMap((name) => [name, `${name}.br`, `${name}.gz`])]);
  for (const name of await readdir(dist)) if (!kept.has(name)) await rm(path.join(dist, name));
}

/** The widget of notebooks: one script of its own in the Python package, with the words and the style sheet in it. */
async function widget() {
  await build({
    ...common,
    entryPoints: ["src/widget/main.ts"],
    outfile: "../python/isocortex/view.js",
    loader: { ".css": "text" },
    minify: true,
  });
}

/** A document that holds all that it runs: the server adds what it shows. */
async function shared(icons, { text: sheet }) {
  const { outputFiles } = await build({ ...common, entryPoints: [SHARED.entry], minify: true, write: false });
  const script = outputFiles[0].text;
  const style = sheet.replace(/\n?\/\*# sourceMappingURL.*\*\/\n?/, "");
  const digest = (text) => `'sha256-${createHash("sha256").update(text).digest("base64")}'`;
  const policy = `default-src 'none'; script-src ${digest(script)}; style-src ${digest(style)}; base-uri 'none'; form-action 'none'`;
  if (/<\/script|<!--/i.test(script) || /<\//.test(style))
    throw new Error("the script or the style would end its element");
  const template = await readFile(path.join(web, SHARED.template), "utf8");
  const values = { icons, policy, script, style };
  return Buffer.from(template.replace(/\{\{(\w+)\}\}/g, (_, name) => values[name]));
}

/** The scripts that a script imports at once, and those that they import. */
function staticImports({ outputs }, script, seen = new Set()) {
  for (const { path: imported, kind } of outputs[script].imports) {
    if (kind !== "import-statement" || seen.has(imported)) continue;
    seen.add(imported);
    staticImports({ outputs }, imported, seen);
  }
  return [...seen];
}

/** Writes a file as it is, and as brotli and gzip. */
async function writeServed(name, contents) {
  const written = await writeChanged(name, contents);
  const missing = written ? [] : await Promise.all(["br", "gz"].map((ending) => read(`${name}.${ending}`)));
  if (!written && !missing.includes(null)) return;
  await writeChanged(`${name}.br`, await promisify(brotliCompress)(contents));
  // Smaller blocks than the default pack this text better.
  await writeChanged(`${name}.gz`, await promisify(gzip)(contents, { level: 9, memLevel: 6 }));
}

const read = (name) => readFile(path.join(dist, name)).catch(() => null);

/** Writes only what has changed, so that cargo does not compile for nothing; whether it has. */
async function writeChanged(name, contents) {
  if ((await read(name))?.equals(contents)) return false;
  await writeFile(path.join(dist, name), contents);
  return true;
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

await (process.argv[2] === "tests" ? tests() : Promise.all([page(), widget()]));
