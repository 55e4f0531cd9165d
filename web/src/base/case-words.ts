// A case in words.

import type { Case, Quality, ReadyCase } from "../model/case.ts";
import { day, known, moment, number, spoken, t } from "./i18n.ts";
import { sentence } from "./problem-words.ts";

/** A case's name in the list. */
export const caseTitle = (one: Case): string => one.name || t("case.unnamed", { id: one.id.slice(0, 8) });

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
      return [day(one.created_at), voxelWords(one), one.volume.sequence ?? ""]
        .filter((part) => part !== "")
        .join(" · ");
    case "failed":
      return failureWords(one);
  }
}

function failureWords(one: Case & { state: "failed" }): string {
  const kind =
    String(one.error?.type ?? "")
      .split(":")
      .at(-1) ?? "";
  const key = known(`problem.${kind}`);
  if (key) return t(key);
  return one.error?.detail ? sentence(one.error.detail) : t("case.failed");
}

/** Why a mask is doubtful: in the server's sentences, which have numbers, or in the page's own in another language. */
export const reasonWords = ({ reasons, reason_codes }: Quality): readonly string[] =>
  reasons.map((reason, at) => {
    const key = spoken() === "en" ? null : known(`reason.${reason_codes?.[at] ?? ""}`);
    return key ? t(key) : sentence(reason);
  });

/** What tells a case from its versions, which have its name. */
export function versionOf(one: Case): string {
  const isVersion = one.previous !== undefined;
  if (!isVersion && !one.next?.length) return "";
  return t(isVersion ? "case.version" : "case.original", { time: moment(one.created_at) });
}

/** The edges of a voxel as it was acquired; one number where they are alike. */
export function voxelWords({ volume: { spacing_mm } }: ReadyCase): string {
  const edges = spacing_mm.map((edge) => number(edge, edge % 1 === 0 ? 0 : 2));
  return `${new Set(edges).size === 1 ? edges[0] : edges.join(" × ")} mm`;
}

/** More of a case than its row has room for. */
export function caseFacts(one: Case): string {
  const known = one.state === "ready" ? [t("case.deep", { depth: number(one.max_depth_mm, 1) })] : [];
  return [caseTitle(one), moment(one.created_at), caseStatus(one), ...known].join("\n");
}

/** What no two cases have in common: label, day and the first digits of the id. */
export const caseIdentity = (one: Case): string =>
  [...(one.name ? [one.name] : []), day(one.created_at), one.id.slice(0, 8)].join(" · ");
