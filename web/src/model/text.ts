// Text that a reader types, as the server accepts and everybody can read it: pure.

/** What turns the writing around, and halves of characters. */
const DROPPED = /[\u202a-\u202e\u2066-\u2069\p{Cs}]/gu;

const cut = (text: string, most: number): string => [...text].slice(0, most).join("");

/** How many characters of a text are more than so many. */
export const excessOf = (text: string, most: number): number =>
  Math.max([...plainText(text, Infinity)].length - most, 0);

/** Lines of at most so many characters together: without what turns the writing around, and with spaces for all other controls. */
export const plainText = (text: string, most: number): string =>
  cut(
    text
      .replace(DROPPED, "")
      .replace(/\r\n?/g, "\n")
      .replace(/[^\P{Cc}\n]/gu, " "),
    most,
  );

/** The same as one line. */
export const plainLine = (text: string, most: number): string =>
  cut(plainText(text, Infinity).replace(/\s+/gu, " ").trim(), most);

/** A text of JSON as what it says; null if it is none. */
export function parsed(text: string | null): unknown {
  try {
    return JSON.parse(text ?? "null");
  } catch {
    return null;
  }
}

/** A number with at most so many digits after the point, as addresses and queries have it. */
export const short = (value: number, digits: number): string => String(Number(value.toFixed(digits)));
