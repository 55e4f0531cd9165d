// What is read out to those who do not see the page, and what is shown for a moment.

import { signal } from "@preact/signals";

export const announced = signal("");
/** What stands on the pictures for a moment, and how many were there before. */
export const noted = signal({ words: "", count: 0 });

export function announce(words: string): void {
  // The same words twice are two messages.
  announced.value = announced.peek() === words ? `${words}\u00a0` : words;
}

/** Reads words out and shows them for a moment: a key that finds nothing to do says so. */
export function note(words: string): void {
  announce(words);
  noted.value = { words, count: noted.peek().count + 1 };
}
