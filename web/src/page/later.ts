// The parts of the page that are fetched when they are first wanted, so that the first picture comes early.

import { Problem } from "../base/api.ts";

type Parts = typeof import("./later-parts.ts");

let parts: Promise<Parts> | null = null;

/** The parts; a `Problem` if they cannot be loaded: the server does not answer, or has another version. */
export function later(): Promise<Parts> {
  parts ??= import("./later-parts.ts").catch(() => {
    parts = null;
    throw new Problem(0, "page-part-missing", "");
  });
  return parts;
}
