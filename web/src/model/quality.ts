// What the server thinks of a case's mask.

import type { Quality } from "./case.ts";

/** What is in doubt about a case, the gravest first: its sides, then its mask. */
type Doubt = "sides" | "review" | "failed";

/** The codes of the reasons that are not about the mask. */
const SIDES = ["axes-corrected", "axes-assumed"];

export function doubtsOf(quality: Quality | undefined): readonly Doubt[] {
  const { state = "ok", reasons = [], reason_codes = [] } = quality ?? {};
  if (state === "ok") return [];
  const sides = reason_codes.filter((code) => SIDES.includes(code)).length;
  const isMask = state === "failed" || !sides || reasons.length > sides;
  return [...(sides ? ["sides" as const] : []), ...(isMask ? [state] : [])];
}
