// The page's words in two languages.

import { EN } from "./words.en.ts";
import { PT } from "./words.pt.ts";

export type Key = keyof typeof EN;
export type Words = Readonly<Record<Key, string>>;

export const LANGUAGES = { en: "English", "pt-BR": "Português" } as const;
export type Language = keyof typeof LANGUAGES;
const WORDS: Readonly<Record<Language, Words>> = { en: EN, "pt-BR": PT };

let language: Language = "en";

export const isLanguage = (text: unknown): text is Language => typeof text === "string" && text in WORDS;

/** The page's language for what a browser says it prefers. */
export const languageFor = (preferred: readonly string[]): Language => {
  for (const tag of preferred) {
    if (/^pt\b/i.test(tag)) return "pt-BR";
    if (/^en\b/i.test(tag)) return "en";
  }
  return "en";
};

export function speak(wanted: Language): void {
  language = wanted;
}

export const spoken = (): Language => language;

/** The words of a key, `{name}` being replaced by the value of that name. */
export function t(key: Key, values: Readonly<Record<string, string | number>> = {}): string {
  return WORDS[language][key].replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** The key where the page has words for it. */
export const known = (key: string): Key | null => (key in EN ? (key as Key) : null);

/** A number as the language writes it, with exactly so many digits after the point. */
export function number(value: number, digits = 0): string {
  const format = new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
  // No minus before a zero.
  return format.format(Number(value.toFixed(digits)) === 0 ? 0 : value);
}

/** An intensity: three figures, or all before the point. */
export function intensity(value: number): string {
  const size = Math.abs(value);
  return number(value, size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 4);
}
