// How the page's modules may stand on each other, and how they are written.

import assert from "node:assert/strict";
import { test } from "node:test";

import { sources, styleSheet } from "./sources.ts";

/** What the modules of each folder may import besides those of their own. */
const BELOW: Readonly<Record<string, readonly string[]>> = {
  model: [],
  base: ["model"],
  gl: ["model"],
  store: ["model", "base"],
  panes: ["model", "base", "gl", "store"],
  page: ["model", "base", "gl", "store", "panes"],
  compare: ["model", "base", "store", "page"],
  launch: ["base", "store", "page"],
  start: ["page", "compare", "launch"],
  widget: ["model", "base", "store", "panes"],
  share: ["model", "base", "store", "page"],
};

const folderOf = (name: string): string => name.split("/")[0] ?? "";

test("every module lies in a folder, and imports only from the folders below its own", () => {
  const all = sources();
  assert.ok(all.length > 40, String(all.length));
  for (const { name, imports } of all) {
    const folder = folderOf(name);
    const allowed = BELOW[folder];
    assert.ok(allowed, `${name} is in none of the folders ${Object.keys(BELOW).join(", ")}`);
    for (const imported of imports) {
      const from = folderOf(imported);
      assert.ok(from === folder || allowed.includes(from), `${name} imports ${imported}`);
    }
  }
});

test("no module imports itself by way of others", () => {
  const imports = new Map(sources().map(({ name, imports: its }) => [name, its]));
  const done = new Set<string>();
  const visit = (name: string, way: readonly string[]): void => {
    assert.ok(!way.includes(name), [...way, name].join(" → "));
    if (done.has(name)) return;
    for (const next of imports.get(name) ?? []) visit(next, [...way, name]);
    done.add(name);
  };
  for (const name of imports.keys()) visit(name, []);
});

test("the model knows no browser", () => {
  for (const { name, text } of sources().filter(({ name: one }) => one.startsWith("model/"))) {
    const code = text.replace(/\/\*[\s\S]*?\*\/|\/\/.*$/gm, "");
    const used = /\b(document|fetch|localStorage|navigator|location|HTMLElement|globalThis)\b[.(]/.exec(code);
    assert.equal(used?.[0], undefined, name);
  }
});

test("private members are in camel case, but for their units", () => {
  for (const { name, text } of sources()) {
    for (const [member] of text.matchAll(/#\w*_\w*/g)) assert.match(member, /^#[A-Za-z]+_(mm|ms|rad)$/, name);
  }
});

test("no type is any", () => {
  for (const { name, text } of sources()) {
    const code = text.replace(/\/\*[\s\S]*?\*\/|\/\/.*$/gm, "");
    assert.doesNotMatch(code, /(:|\bas|<|,)\s*any\b/, name);
  }
});

test("no style of a wide page looks into what holds the panes", () => {
  // Whatever changes in a pane with each frame would be looked for in all of the page: a thousand findings doubled a frame.
  const wide = styleSheet().replace(/@media \(max-width[^{]*\{(?:[^{}]*\{[^{}]*\})*[^{}]*\}/g, "");
  assert.ok(wide.includes(".pane") && !wide.includes("--hint: 3.4rem"));
  assert.deepEqual(wide.match(/(?:body|html|\.(?:app|page|stage|viewer|panes|pane|framed))[^\s,{]*:has\([^{]*/g), null);
});
