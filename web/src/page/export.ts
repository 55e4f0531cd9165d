// What leaves the page: a picture of it, and its address. Each tells in words what became of it.

import { viewName } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { type MapOverlay, styleOf } from "../model/maps.ts";
import { hasSlices, type ViewState } from "../model/state.ts";
import { caseIdentity } from "../base/case-words.ts";
import { intensity, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { depthWords, positionWords } from "../base/readout.ts";
import { type Placed, paintPanes } from "../panes/screenshot.ts";
import type { SliceGroup } from "../panes/slice-group.ts";
import type { SurfacePane } from "../panes/surface-pane.ts";
import { captioned, programWords, saveFile } from "./picture-file.ts";

/** What is on the screen. */
export interface OnScreen {
  readonly shown: ReadyCase;
  readonly state: ViewState;
  readonly panes: HTMLElement;
  readonly surface: SurfacePane;
  readonly slices: SliceGroup;
}

/** How a file of a case begins: with the first digits of its id. */
export const fileStem = (shown: Pick<ReadyCase, "id">): string => `isocortex-${shown.id.slice(0, 8)}`;

/** What stands below every picture of a case: whose it is, how it is seen, what drew it and what it is not for. */
export async function captionOf(shown: ReadyCase, state: ViewState): Promise<string[]> {
  const { window, colormap, overlay, crosshair_mm } = state;
  const parts = [
    depthWords(state),
    t(`view.${viewName(state.orientation) ?? "oblique"}`),
    t("caption.window", { center: intensity(window.center), width: intensity(window.width) }),
    ...(colormap === "grey" ? [] : [t(`colormap.${colormap}`)]),
    ...(overlay ? [overlayWords(overlay)] : []),
    ...(crosshair_mm ? [t("caption.point", { position: positionWords(crosshair_mm).replaceAll(" · ", " ") })] : []),
  ];
  return [caseIdentity(shown), parts.join(" · "), `${await programWords()} · ${t("notice.long")}`];
}

/** Which map lies over the picture, and how. */
function overlayWords({ name, threshold, opacity }: MapOverlay): string {
  const { unit, window } = styleOf(name);
  const range = t("caption.map", {
    name: t(`map.${name}`),
    low: number(window[0], 1),
    high: number(window[1], 1),
    unit,
  });
  const above = threshold === null ? [] : [t("caption.threshold", { threshold: number(threshold, 1) })];
  return [range.trim(), ...above, t("caption.opacity", { share: number(100 * opacity) })].join(", ");
}

/** The panes with their caption, as PNG. */
async function pictureOf({ shown, state, panes, surface, slices }: OnScreen, times: number): Promise<Blob> {
  const ratio = times * devicePixelRatio;
  const [own, others, caption] = await Promise.all([
    surface.picture(ratio),
    hasSlices(state) ? slices.pictures(ratio) : [],
    captionOf(shown, state),
  ]);
  const all: readonly Placed[] = [{ element: surface.host, picture: own, isFlipped: false }, ...others];
  const { clientWidth: width, clientHeight: height } = panes;
  return captioned({ width, height, ratio, caption }, (context) => paintPanes(context, panes, all));
}

/** Saves the panes as they stand, with so many times the screen's pixels. */
export async function savePicture(view: OnScreen, times: number): Promise<string> {
  try {
    saveFile(await pictureOf(view, times), `${fileStem(view.shown)}-${view.state.depth_mm.toFixed(1)}mm.png`);
    return t("export.saved");
  } catch (error) {
    return problemWords(error);
  }
}

/** Puts the same into the clipboard. */
export async function copyPicture(view: OnScreen, times: number): Promise<string> {
  try {
    // The picture is promised: a browser wants to hear of it while the click is fresh.
    await navigator.clipboard.write([new ClipboardItem({ "image/png": pictureOf(view, times) })]);
    return t("export.picture-copied");
  } catch (error) {
    const isForbidden = error instanceof DOMException || typeof ClipboardItem === "undefined";
    return isForbidden ? t("export.no-clipboard") : problemWords(error);
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
