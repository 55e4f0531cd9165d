// What leaves the page: a picture of it, and its address. Each tells in words what became of it.

import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { saveScreenshot } from "../panes/screenshot.ts";
import type { SurfacePane } from "../panes/surface-pane.ts";

/** Saves the panes as they stand, as a file of a name. */
export async function saveView(panes: HTMLElement, surface: SurfacePane, name: string): Promise<string> {
  try {
    await saveScreenshot(panes, await surface.picture(), surface.host, name);
    return t("export.saved");
  } catch (error) {
    return problemWords(error);
  }
}

/** Copies an address; where that is forbidden, it is told instead. */
export async function copied(address: string): Promise<string> {
  try {
    await navigator.clipboard.writeText(address);
    return t("export.copied");
  } catch {
    return address;
  }
}
