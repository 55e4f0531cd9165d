// What is read out to those who do not see the page.

import { signal } from "@preact/signals";

export const announced = signal("");

/** Reads words out. */
export function announce(words: string): void {
  // The same words twice are two messages.
  announced.value = announced.peek() === words ? `${words}\u00a0` : words;
}
