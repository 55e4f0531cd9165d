// A case in words.

import { kindOf } from "./api.ts";
import type { Case, ProblemBody, Quality, ReadyCase } from "../model/case.ts";
import { day, known, moment, number, numberUpTo, spoken, t } from "./i18n.ts";
import { sentence, withNumbers } from "./problem-words.ts";

/** A case's name in the list. */
export const caseTitle = (one: Case): string => one.name || t("case.unnamed", { id: one.id.slice(0, 8) });

/** A title of more letters than this may have no room in a row beside a badge; the last ones, as long as a date, are always seen. */
const LONG_TITLE = 13;
const TITLE_END = 10;

/** A title in two parts, between which a row may cut it; the second one is empty if it is never cut. */
export function titleParts(title: string): readonly [string, string] {
  return title.length <= LONG_TITLE ? [title, ""] : [title.slice(0, -TITLE_END), title.slice(-TITLE_END)];
}

/** What a row surely shows of a title: all, or its first and its last letters. */
export function shortTitle(one: Case): string {
  const [begins, ends] = titleParts(caseTitle(one));
  return ends === "" ? begins : `${begins.slice(0, LONG_TITLE - TITLE_END)}\u2026${ends}`;
}

/** The cases that share what is surely shown of their titles, by that. */
export function alike(cases: readonly Case[]): ReadonlyMap<string, readonly Case[]> {
  const found = new Map<string, Case[]>();
  for (const one of cases) {
    const others = found.get(shortTitle(one));
    if (others) others.push(one);
    else found.set(shortTitle(one), [one]);
  }
  return found;
}

/** What a reader may know a case by, besides its title: first what says the most. */
const TELLING: readonly ((one: ReadyCase) => string)[] = [
  ({ volume }) => (volume.series_number === undefined ? "" : `${t("case.SeriesDescription")} ${volume.series_number}`),
  ({ volume }) => volume.sequence ?? "",
  (one) => voxelWords(one),
  ({ volume }) => volume.size.join(" × "),
  ({ closing_radius_mm }) => `${t("case.radius")} ${numberUpTo(closing_radius_mm, 1)} mm`,
];

/** What differs among cases with the same title. */
interface Telling {
  readonly parts: readonly ((one: ReadyCase) => string)[];
  /** Whether two were uploaded on one day, so that the time is needed. */
  readonly hasTime: boolean;
  /** Those that nothing tells apart but their ids. */
  readonly twins: ReadonlySet<Case>;
}

const KNOWN = new WeakMap<readonly Case[], Telling>();
const minuteOf = (one: Case): string => one.created_at.slice(0, 16);

function tellingOf(others: readonly Case[]): Telling {
  const found = KNOWN.get(others);
  if (found) return found;
  const ready = others.filter((one) => one.state === "ready");
  const parts = TELLING.filter((part) => new Set(ready.map(part)).size > 1);
  const hasTime = new Set(others.map(({ created_at }) => new Date(created_at).toDateString())).size < others.length;
  const seen = new Map<string, ReadyCase>();
  const twins = new Set<Case>();
  for (const one of ready) {
    const all = [minuteOf(one), ...parts.map((part) => part(one))].join("\n");
    const twin = seen.get(all);
    if (twin) twins.add(one).add(twin);
    seen.set(all, one);
  }
  const telling = { parts, hasTime, twins };
  KNOWN.set(others, telling);
  return telling;
}

/** What tells a case apart from those with the same title, one of them; empty if it is the only one, or is not ready. */
export function toldApart(one: Case, others: readonly Case[]): string {
  if (one.state !== "ready" || others.length < 2) return "";
  const { parts, hasTime, twins } = tellingOf(others);
  const differing = parts.map((part) => part(one)).filter((words) => words !== "");
  const id = twins.has(one) ? [one.id.slice(0, 8)] : [];
  return [...id, ...differing, (hasTime ? moment : day)(one.created_at)].join(" · ");
}

/** What a case is at, in words. */
export function caseStatus(one: Case): string {
  switch (one.state) {
    case "queued":
      return t("case.queued");
    case "preparing": {
      const stage = known(`stage.${one.progress?.stage ?? ""}`) ?? "case.preparing";
      const fraction = one.progress?.fraction;
      return t(stage) + (typeof fraction === "number" ? ` · ${number(100 * fraction)} %` : "");
    }
    case "ready":
      return [day(one.created_at), voxelWords(one, 1), one.volume.sequence ?? ""]
        .filter((part) => part !== "")
        .join(" · ");
    case "failed":
      return failureWords(one.error);
  }
}

/** Why a case or a layer could not be prepared. */
export function failureWords(error: ProblemBody | undefined): string {
  const key = known(`problem.${kindOf(error)}`);
  if (key) return withNumbers(t(key), error?.detail ?? "");
  return error?.detail ? sentence(error.detail) : t("case.failed");
}

/** A reason in the server's sentence, which has numbers, or by its code in the page's own in another language. */
export function reasonIn(reason: string, code = ""): string {
  const key = spoken() === "en" ? null : known(`reason.${code}`);
  return key ? t(key) : sentence(reason);
}

/** Why a mask is doubtful. */
export const reasonWords = ({ reasons, reason_codes }: Quality): readonly string[] =>
  reasons.map((reason, at) => reasonIn(reason, reason_codes?.[at]));

/** Distinguishes a case from its versions, which have the same name. */
export function versionOf(one: Case): string {
  const isVersion = one.previous !== undefined;
  if (!isVersion && !one.next?.length) return "";
  return t(isVersion ? "case.version" : "case.original", { ...one, time: moment(one.created_at) });
}

/** The edges of a voxel as it was acquired; one number where they are alike. */
export function voxelWords({ volume: { spacing_mm } }: ReadyCase, digits = 2): string {
  const edges = spacing_mm.map((edge) => numberUpTo(edge, digits));
  return `${new Set(edges).size === 1 ? edges[0] : edges.join(" × ")} mm`;
}

/** More of a case than its row has room for. */
export function caseFacts(one: Case): string {
  const known = one.state === "ready" ? [t("case.deep", { depth: number(one.max_depth_mm, 1) })] : [];
  return [caseTitle(one), moment(one.created_at), caseStatus(one), ...known].join("\n");
}

/** What no two cases have in common: label, day and the first digits of the id, which name a case without a label. */
export const caseIdentity = (one: Case): string =>
  [caseTitle(one), t("case.added", { day: day(one.created_at) }), ...(one.name ? [one.id.slice(0, 8)] : [])].join(
    " · ",
  );
