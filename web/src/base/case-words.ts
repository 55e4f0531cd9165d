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
      return seriesWords(one);
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

/** The number of the series, the edges of a voxel and the sequence, as far as they are known. */
export function seriesWords(one: ReadyCase): string {
  const { series_number, sequence = "" } = one.volume;
  const series = series_number === undefined ? "" : `${t("case.SeriesDescription")} ${series_number}`;
  return [series, voxelWords(one, 1), sequence].filter((part) => part !== "").join(" · ");
}

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
