// What the server thinks of a case's mask.

import type { Quality, ReadyCase } from "./case.ts";

/** The server's verdict; null where it gave none, or one that this page does not know. */
export function qualityOf(shown: ReadyCase): Quality | null {
  const quality = shown.quality;
  return quality && ["ok", "review", "failed"].includes(quality.state) ? quality : null;
}

/** What is in doubt about a case, the gravest first: its sides, then its mask. */
export type Doubt = "sides" | "review" | "failed";

/** The code of the one reason that is not about the mask. */
const SIDES = "axes-corrected";

export function doubtsOf({ state, reasons, reason_codes = [] }: Quality): readonly Doubt[] {
  if (state === "ok") return [];
  const areSides = reason_codes.includes(SIDES);
  const isMask = state === "failed" || !areSides || reasons.length > 1;
  return [...(areSides ? ["sides" as const] : []), ...(isMask ? [state] : [])];
}
