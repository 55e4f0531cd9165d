// What the browser keeps of the page. It may forbid to: then all of it lasts until the page is closed.

import { parsed } from "../model/text.ts";

type Where = "localStorage" | "sessionStorage";

export function keptText(where: Where, key: string): string | null {
  try {
    return globalThis[where].getItem(key);
  } catch {
    return null;
  }
}

export function keep(where: Where, key: string, value: unknown): void {
  try {
    globalThis[where].setItem(key, JSON.stringify(value));
  } catch {
    // Forbidden, or full.
  }
}

const OWNER = "isocortex-owner";
const keptOwner = (): string => String(parsed(keptText("localStorage", OWNER)) ?? "");
let owner = keptOwner();

/** Makes what the browser keeps of choices somebody's, of whom this page is; returns whose it was; empty: nobody's in particular. */
export function own(name: string): string {
  const before = owner;
  owner = name;
  keep("localStorage", OWNER, name);
  return before;
}

/** Whether what the browser keeps of choices is still of whom this page is: another page may be of somebody else. */
export const isOwn = (): boolean => keptOwner() === owner;

/** Takes a text that another document has left in this tab, once; empty if there is none. */
export function taken(key: string): string {
  const text = keptText("sessionStorage", key) ?? "";
  if (text !== "") sessionStorage.removeItem(key);
  return text;
}
