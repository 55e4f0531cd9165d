// What the server thinks of a case's mask.

import type { Quality, ReadyCase } from "./case.ts";

/** The server's verdict; null where it gave none, or one that this page does not know. */
export function qualityOf(shown: ReadyCase): Quality | null {
  const quality = shown.quality;
  return quality && ["ok", "review", "failed"].includes(quality.state) ? quality : null;
}
