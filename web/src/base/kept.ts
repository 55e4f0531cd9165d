// What the browser keeps of the page. It may forbid to: then all of it lasts until the page is closed.

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

/** Takes a text that another document has left in this tab, once; empty if there is none. */
export function taken(key: string): string {
  const text = keptText("sessionStorage", key) ?? "";
  if (text !== "") sessionStorage.removeItem(key);
  return text;
}
