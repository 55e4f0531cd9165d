// The readings of a case: what named readers conclude, and where two of them agree.

import { type Finding, middleOf, numbered } from "./findings.ts";
import { distance } from "./space.ts";

/** The longest conclusion that the server accepts. */
export const LONGEST_CONCLUSION = 10_000;

/** A version of a reading in the list of the server. */
export interface ListedReading {
  readonly reader: string;
  readonly version: number;
  readonly state: "open" | "signed";
  readonly signed_at?: string;
  readonly is_mine: boolean;
  /** Whether its contents may be seen by whoever asks. */
  readonly is_shown: boolean;
}

/** The fields of a template, each with the group of the page's words that it is stated in. */
export const TEMPLATE = {
  side: "side",
  lobe: "lobe",
  gyrus: "gyrus",
  blur: "sign",
  thickening: "sign",
  transmantle: "sign",
  flair: "sign",
  sulcal_bottom: "sign",
  certainty: "certainty",
} as const;
export type Field = keyof typeof TEMPLATE;
export const FIELDS = Object.keys(TEMPLATE) as readonly Field[];
export type Template = { readonly [Of in Field]?: string };

/** What a reader writes: as text, and in fixed words. */
export interface Written {
  readonly conclusion: string;
  readonly template: Template;
}

export interface Reading extends Written {
  readonly reader: string;
  readonly version: number;
  readonly state: "open" | "signed";
  readonly signed_at?: string;
  readonly findings: readonly Finding[];
}

/** The readings of others: of each reader the last signed version, or the open one if none is signed. */
export function ofOthers(readings: readonly ListedReading[]): readonly ListedReading[] {
  const last = new Map<string, ListedReading>();
  for (const one of readings)
    if (!one.is_mine && (one.state === "signed" || !last.has(one.reader))) last.set(one.reader, one);
  return [...last.values()];
}

/** So near to each other two findings are of one place, in mm. */
export const SAME_PLACE_MM = 10;

/** The findings of two readings: those of one place in pairs, and those of one reader alone. */
export interface Compared {
  readonly both: readonly (readonly [Finding, Finding])[];
  readonly mine: readonly Finding[];
  readonly theirs: readonly Finding[];
}

/** Compares what two readers have kept; the nearest findings are pairs first, and each is in one pair at most. */
export function compared(mine: readonly Finding[], theirs: readonly Finding[]): Compared {
  const [own, other] = [numbered(mine), numbered(theirs)];
  const near = own
    .flatMap((one) => other.map((two) => ({ one, two, mm: distance(middleOf(one), middleOf(two)) })))
    .filter(({ mm }) => mm <= SAME_PLACE_MM)
    .sort((a, b) => a.mm - b.mm);
  const paired = new Map<Finding, Finding>();
  const taken = new Set<Finding>();
  for (const { one, two } of near) {
    if (paired.has(one) || taken.has(two)) continue;
    paired.set(one, two);
    taken.add(two);
  }
  return {
    both: own.flatMap((one) => {
      const two = paired.get(one);
      return two ? [[one, two] as const] : [];
    }),
    mine: own.filter((one) => !paired.has(one)),
    theirs: other.filter((one) => !taken.has(one)),
  };
}
