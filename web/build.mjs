// Bundles the page into dist/, which the server carries: `node build.mjs`.
// `node build.mjs tests` bundles the tests into build/ instead, for Node to run.

import { createHash } from "node:crypto";
import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";

import { build } from "esbuild";
import { minify } from "terser";

const web = import.meta.dirname;
const dist = path.join(web, "dist");
const common = { absWorkingDir: web, bundle: true, format: "esm", target: "es2022", logLevel: "warning" };

/** Only what has changed is written, so that cargo does not compile for nothing. */
async function writeChanged(file, contents) {
  const before = await readFile(file).catch(() => null);
  if (!before?.equals(contents)) await writeFile(file, contents);
}

async function page() {
  const { files, members } = await scripts();
  const { outputFiles } = await build({
    ...common,
    entryPoints: ["src/style.css"],
    outdir: "dist",
    minify: true,
    write: false,
  });
  files.set("style.css", Buffer.from(outputFiles[0].contents));
  for (const page of ["index.html", "compare/compare.html"])
    files.set(path.basename(page), await readFile(path.join(web, "src", page)));
  const short = await shortKeys();
  for (const words of ["words.en.json", "words.pt-BR.json"]) {
    const entries = Object.entries(JSON.parse(await readFile(path.join(web, "src", words), "utf8")));
    const named = Object.fromEntries(entries.map(([key, text]) => [short.get(key) ?? key, text]));
    files.set(words, Buffer.from(JSON.stringify(named)));
  }
  files.set("shaders.json", Buffer.from(await shaders(members)));
  await mkdir(dist, { recursive: true });
  for (const [name, contents] of files) await writeChanged(path.join(dist, name), contents);
  for (const name of await readdir(dist)) if (!files.has(name)) await rm(path.join(dist, name));
}

const LATER = "src/page/later-parts.ts";
const FIRST = "src/page/main.ts";
/** Where the second script finds what the first one exports. */
const FIRST_SCRIPT = "./main.js";
const FOLDERS = ["model", "gl", "base", "panes", "page"];

/**
 * The two scripts: the first one, and what it imports on demand, which takes from the first what both need. (Shared chunks
 * of the bundler's own would be a third file, with lists of all names, and compress worse.) The name of the second changes
 * with the content of both: a page that is open while the server is replaced never gets a part of another version.
 */
async function scripts() {
  const [keys, members, constants] = [await shortKeys(), await membersOfItsOwn(), await glConstants()];
  // The shaders have these names as well, in which no dollar may be.
  const names = new Map((await uniforms()).map((name, at) => [name, `f${at.toString(36)}`]));
  const short = { keys, members, cache: { props: names } };
  const modules = await modulesOf(FIRST, [leftOut]);
  const shared = await sharedNames(new Set(modules));
  const [laterOnly, all] = [`export * from "./${LATER}";`, `${inOrder(modules)}${handedOn(shared)}`];
  const later = await squeezed(await script(laterOnly, [takenFromFirst(shared), constants]), short);
  const first = await squeezed(await script(all, [leftOut, constants]), short);
  const digest = createHash("sha256").update(first).update(later).digest("hex").slice(0, 8);
  const name = `later-parts-${digest}.js`;
  // The page that compares two cases reads their states: its members have the same names.
  const comparing = await squeezed(await script(`import "./src/compare/main.ts";`, [constants]), short);
  const files = new Map([
    ["compare.js", Buffer.from(comparing)],
    ["main.js", Buffer.from(first.replaceAll(LATER, `./${name}`))],
    [name, Buffer.from(later)],
  ]);
  return { files, members: names };
}

/** Bundles a module with all that it imports. */
const bundle = (contents, plugins) =>
  build({
    ...common,
    stdin: { contents, resolveDir: web },
    outdir: "dist",
    minify: true,
    write: false,
    metafile: true,
    plugins,
  });

const script = async (contents, plugins) => (await bundle(contents, plugins)).outputFiles[0].text;

/** The modules of a script, by their paths below `web`. */
async function modulesOf(file, plugins) {
  const { metafile } = await bundle(`import "./${file}";`, plugins);
  return Object.keys(metafile.inputs).filter((input) => input.startsWith("src/"));
}

/** Imports modules folder by folder: those of one folder resemble each other, and compress better side by side. */
function inOrder(modules) {
  const place = (file) => FOLDERS.findIndex((folder) => file.startsWith(`src/${folder}/`));
  const sorted = modules.toSorted((a, b) => place(a) - place(b) || (a < b ? -1 : 1));
  return sorted.map((file) => `import "./${file}";\n`).join("");
}

/** Calls `resolve` with the path of each module below `web` that another one imports. */
const resolving = (name, resolve, setup = () => {}) => ({
  name,
  setup(build) {
    build.onResolve({ filter: /\.ts$/ }, ({ path: named, resolveDir, kind }) =>
      resolve(path.relative(web, path.join(resolveDir, named)), kind),
    );
    setup(build);
  },
});

/** Leaves the second script out of the first, which imports it by its name in `web` until that of its file is known. */
const leftOut = resolving("left out", (file, kind) =>
  kind === "dynamic-import" && file === LATER ? { path: LATER, external: true } : null,
);

/** What the second script imports of the modules of the first: by module, names of its own by names. */
async function sharedNames(modules) {
  const names = resolving("names", (file) => (modules.has(file) ? { path: `first:${file}`, external: true } : null));
  const text = await script(`export * from "./${LATER}";`, [names]);
  const shared = new Map();
  let count = 0;
  for (const [, list, file] of text.matchAll(/import\{([^}]*)\}from"first:([^"]*)"/g)) {
    const names = shared.get(file) ?? new Map();
    shared.set(file, names);
    for (const [name] of list.split(",").map((one) => one.split(" as ")))
      names.set(name, names.get(name) ?? `shared_${count++}`);
  }
  return shared;
}

/** All that is shared, in the order in which it is handed on. */
const inTurn = (shared) => [...shared.values()].flatMap((names) => [...names.values()]);

/** The first script exports one array of all that the second needs: take fewer bytes than names. */
const handedOn = (shared) => {
  const imports = [...shared].map(
    ([file, names]) => `import { ${[...names].map(([name, own]) => `${name} as ${own}`)} } from "./${file}";\n`,
  );
  return `${imports.join("")}export const shared = [${inTurn(shared)}];\n`;
};

/** In the place of the modules of the first script, what it hands on. */
const takenFromFirst = (shared) =>
  resolving(
    "taken from the first",
    (file) => (shared.has(file) ? { path: file, namespace: "first" } : null),
    (build) => {
      build.onResolve({ filter: /^first$/, namespace: "first" }, () => ({ path: "all", namespace: "first" }));
      build.onResolve({ filter: /\.js$/, namespace: "first" }, () => ({ path: FIRST_SCRIPT, external: true }));
      build.onLoad({ filter: /./, namespace: "first" }, ({ path: file }) => ({
        contents:
          file === "all"
            ? `import { shared } from "${FIRST_SCRIPT}";\nexport const [${inTurn(shared)}] = shared;\n`
            : `export { ${[...shared.get(file)].map(([name, own]) => `${own} as ${name}`)} } from "first";\n`,
      }));
    },
  );

/** A script in fewer bytes than the bundler's, with short keys of words and short names of its own members. */
async function squeezed(text, { keys, members, cache }) {
  const { code } = await minify(text, {
    module: true,
    ecma: 2020,
    compress: {
      passes: 4,
      unsafe: true,
      unsafe_arrows: true,
      pure_getters: true,
      lhs_constants: false,
      inline: 1,
      booleans: false,
    },
    mangle: { properties: { regex: members, keep_quoted: true, cache } },
  });
  return code.replace(/"([\w-]+(?:\.[\w-]+)+)"/g, (whole, key) => (keys.has(key) ? `"${keys.get(key)}"` : whole));
}

/** The texts of all modules. */
async function sources() {
  const folder = path.join(web, "src");
  const names = (await readdir(folder, { recursive: true })).filter((name) => name.endsWith(".ts"));
  return Promise.all(names.map((name) => readFile(path.join(folder, name), "utf8")));
}

/** Long names of members that, like those in camelCase, no JSON, shader, attribute or browser has. */
const OWN = `about actions announce averages_shallow bare_window comparison complain contour_count contours_mm convention
  crosshair_mm describe drawable encode enlarge equipment fetched gradients internal isLast isReady
  isStep isWhole keepsName letter measured mm_per_pixel mm_per_s native_spacing_mm outlines_mm painter pictures
  placing points_per_contour preferences redraw retryAfter stride strip texels trouble unread voxel_from_patient
  voxels wanted`;

/** Fields of the shaders' uniform blocks that the scripts have elsewhere as well, as members of their own. */
const SHARED_FIELDS = [
  "color_row",
  "field_size",
  "first_piece",
  "origin_in_patient",
  "row_mm",
  "volume_size",
  "voxel_mm",
];

/** Finds the members that only the page names: JSON has none in camelCase, and the minifier leaves those of the browser. */
async function membersOfItsOwn() {
  const text = (await sources()).join("\n");
  const declared = text.matchAll(/^ {2}(?:readonly |async |get |\*)*([a-z]+[A-Z]\w*)\??[(:<]/gm);
  const words = await readFile(path.join(web, "src/words.en.json"), "utf8");
  // The second script exports its parts under their own names.
  const parts = (await readFile(path.join(web, LATER), "utf8")).match(/\w+/g);
  const isData = (name) => text.includes(`dataset.${name}`) || words.includes(`{${name}}`) || parts.includes(name);
  const names = [...OWN.split(/\s+/), ...[...declared].map(([, name]) => name)].filter((name) => !isData(name));
  return new RegExp(`^(${[...new Set([...names, ...(await uniforms())])].join("|")})$`);
}

/** The fields of the shaders' uniform blocks that nothing else in the scripts is called. */
async function uniforms() {
  const { blocks } = JSON.parse(await readFile(path.join(web, "shaders/names.json"), "utf8"));
  const elsewhere = (await sources()).filter((text) => !text.includes("The fields of a uniform block by name")).join();
  const fields = Object.values(blocks).flatMap(({ offsets }) => Object.keys(offsets));
  const isOwn = (name) => name.includes("_") && !new RegExp(`\\b${name}\\b`).test(elsewhere);
  return fields.filter((name) => SHARED_FIELDS.includes(name) || isOwn(name));
}

/** Writes the constants of WebGL as numbers, from the table of TypeScript. */
async function glConstants() {
  const [tables] = await filesNamed("node_modules/@typescript", "lib/lib.dom.d.ts");
  const lines = (await readFile(tables, "utf8")).matchAll(/readonly ([A-Z]\w+): (0x[0-9A-F]+);/g);
  const numbers = new Map([...lines].map(([, name, number]) => [name, Number(number)]));
  const number = (whole, name) => String(numbers.get(name) ?? whole);
  return {
    name: "constants of WebGL",
    setup({ onLoad }) {
      onLoad({ filter: /src.gl.\w+\.ts$/, namespace: "file" }, async ({ path: file }) => ({
        contents: (await readFile(file, "utf8")).replace(/\b(?:this\.#)?gl\.([A-Z]\w+)/g, number),
        loader: "ts",
      }));
    },
  };
}

/** Short names for the keys of words that no script puts together from parts. */
async function shortKeys() {
  const texts = await sources();
  const parts = texts.flatMap((text) => [...text.matchAll(/`([\w.-]*)\$\{/g)]).map(([, part]) => part);
  const isPut = (key) => parts.some((part) => part.includes(".") && key.startsWith(part));
  const keys = Object.keys(JSON.parse(await readFile(path.join(web, "src/words.en.json"), "utf8")));
  const isWhole = (key) => key.includes(".") && !isPut(key) && texts.some((text) => text.includes(`"${key}"`));
  return new Map(keys.filter(isWhole).map((key, number) => [key, `.${number.toString(36)}`]));
}

/**
 * The shaders' texts by name, without what only people read, the names in them, and the tables of the colours. Fields of
 * blocks have the names that `members` gives them in the scripts.
 */
async function shaders(members) {
  const json = async (name) => JSON.parse(await readFile(path.join(web, "shaders", name), "utf8"));
  const names = (await readdir(path.join(web, "shaders"))).filter((name) => name.endsWith(".glsl")).sort();
  const glsl = async (name) => (await readFile(path.join(web, name), "utf8")).replace(/\n\s*/g, "\n").trim();
  const texts = names.map(async (name) => [name, await glsl(`shaders/${name}`)]);
  const equipment = {
    shaders: Object.fromEntries(await Promise.all(texts)),
    names: await json("names.json"),
    colors: await json("colors.json"),
    probe: await Promise.all(["vert", "frag"].map((kind) => glsl(`src/gl/probe.${kind}.glsl`))),
  };
  const fields = new RegExp(`\\b(${(await uniforms()).join("|")})\\b`, "g");
  return JSON.stringify(equipment).replace(fields, (field) => members.get(field) ?? field);
}

/** A file of each package of a scope that has it. */
async function filesNamed(scope, file) {
  const packages = await readdir(path.join(web, scope), { recursive: true });
  return packages.filter((name) => name.endsWith(file)).map((name) => path.join(web, scope, name));
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
