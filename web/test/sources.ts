// The page's own sources, for the tests that read them.

import { readFileSync, readdirSync } from "node:fs";
import path from "node:path";

const FOLDER = path.join(import.meta.dirname, "../../src");

export interface Source {
  /** Below `src`, with forward slashes. */
  readonly name: string;
  readonly text: string;
  /** The modules of the page that it imports, named as itself. */
  readonly imports: readonly string[];
}

/** Every module of the page. */
export function sources(): Source[] {
  const names = readdirSync(FOLDER, { recursive: true, encoding: "utf8" }).map((name) => name.replaceAll("\\", "/"));
  return names
    .filter((name) => /\.tsx?$/.test(name))
    .map((name) => {
      const text = readFileSync(path.join(FOLDER, name), "utf8");
      const imported = [...text.matchAll(/(?:from|import\()\s*"(\.[^"]*\.tsx?)"/g)];
      return { name, text, imports: imported.map(([, to]) => path.posix.join(path.posix.dirname(name), to ?? "")) };
    });
}

/** The style sheet, without its comments. */
export const styleSheet = (): string =>
  readFileSync(path.join(FOLDER, "style.css"), "utf8").replace(/\/\*[^]*?\*\//g, "");
