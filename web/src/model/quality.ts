// What the server thinks of a case's mask.

import type { Quality } from "./case.ts";

/** What is in doubt about a case, the gravest first: its sides, then its mask. */
type Doubt = "sides" | "review" | "failed";

/** The code of the one reason that is not about the mask. */
const SIDES = "axes-corrected";

export function doubtsOf(quality: Quality | undefined): readonly Doubt[] {
  const { state = "ok", reasons = [], reason_codes = [] } = quality ?? {};
  if (state === "ok") return [];
  const areSides = reason_codes.includes(SIDES);
  const isMask = state === "failed" || !areSides || reasons.length > 1;
  return [...(areSides ? ["sides" as const] : []), ...(isMask ? [state] : [])];
}
