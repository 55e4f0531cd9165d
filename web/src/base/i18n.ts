// The page's words, each language in a script of its own: only the one that is spoken is fetched.

import { clamp } from "../model/space.ts";
import { wait } from "./patience.ts";
import type english from "../words.en.json";

export type Key = keyof typeof english;
export type Words = Readonly<Record<Key, string>>;

export const LANGUAGES = { en: "English", "pt-BR": "Português" } as const;
export type Language = keyof typeof LANGUAGES;

const WORDS: Readonly<Record<Language, () => Promise<{ readonly default: Words }>>> = {
  en: () => import("../words.en.json", { with: { type: "json" } }),
  "pt-BR": () => import("../words.pt-BR.json", { with: { type: "json" } }),
};

let language: Language = "en";
let words: Words = {} as Words;

export const isLanguage = (text: unknown): text is Language => typeof text === "string" && text in LANGUAGES;

/** The page's language for what a browser says it prefers. */
export const languageFor = (preferred: readonly string[]): Language => {
  for (const tag of preferred) {
    if (/^pt\b/i.test(tag)) return "pt-BR";
    if (/^en\b/i.test(tag)) return "en";
  }
  return "en";
};

export function speak(wanted: Language, its: Words): void {
  language = wanted;
  words = its;
}

/** Fetches a language's words and speaks it; a server that does not answer is asked again. */
export async function learn(wanted: Language): Promise<void> {
  for (;;) {
    try {
      return speak(wanted, (await WORDS[wanted]()).default);
    } catch {
      // Asked again below.
    }
    await wait(1000);
  }
}

export const spoken = (): Language => language;

/** The words of a key, `{name}` being replaced by the value of that name. */
export function t(key: Key, values: Readonly<Record<string, unknown>> = {}): string {
  return words[key].replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** All words from one key to before another, in the order of their file. */
export function wordsBetween(first: Key, end: Key): readonly string[] {
  const keys = Object.keys(words) as Key[];
  return keys.slice(keys.indexOf(first), keys.indexOf(end)).map((key) => words[key]);
}

/** The key where the page has words for it. */
export const known = (key: string): Key | null => (key in words ? (key as Key) : null);

/** The name of a gyrus, which is about where a place is; empty where it is not known. */
export function gyrusWords(gyrus: string | undefined): string {
  const key = known(`gyrus.${gyrus}`);
  return key ? t(key) : "";
}

/** The words of a group of keys, by what follows its name. */
export const namesOf = (group: string): readonly string[] =>
  Object.keys(words).flatMap((key) => (key.startsWith(group) ? [key.slice(group.length)] : []));

/** A number as the language writes it, with exactly so many digits after the point. */
export function number(value: number, digits = 0): string {
  const format = new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
  // No minus before a zero.
  return format.format(Number(value.toFixed(digits)) === 0 ? 0 : value);
}

/** A number with at most so many digits after the point, without zeros at its end. */
export function numberUpTo(value: number, digits: number): string {
  const rounded = Number(value.toFixed(digits));
  return number(rounded, String(rounded).split(".")[1]?.length);
}

/** A number in a field: with so many figures, or all before the point, and without marks between thousands. */
export function plainNumber(value: number, figures: number): string {
  const before = Math.floor(Math.log10(Math.max(Math.abs(value), 1e-9))) + 1;
  const maximumFractionDigits = clamp(figures - before, 0, 12);
  return new Intl.NumberFormat(language, { maximumFractionDigits, useGrouping: false }).format(value);
}

/** The number that somebody wrote, with a point or a comma; NaN where it is none. */
export const readNumber = (text: string): number => (text.trim() === "" ? NaN : Number(text.trim().replace(",", ".")));

/** The day of an RFC 3339 text as the language writes it: short, unless day and month could be confused. */
export const day = (text: string): string =>
  new Intl.DateTimeFormat(language, { dateStyle: language === "en" ? "medium" : "short" }).format(new Date(text));

/** Day and time as the language writes them, of an RFC 3339 text. */
export const moment = (text: string): string =>
  new Intl.DateTimeFormat(language, { dateStyle: "medium", timeStyle: "short", hourCycle: "h23" }).format(
    new Date(text),
  );

/** An intensity: three figures, or all before the point. */
export function intensity(value: number): string {
  const size = Math.abs(value);
  return number(value, size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 4);
}
