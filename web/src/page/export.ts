// Exports: a picture of the page, and its address. Each returns a sentence about the result.

import { viewName } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { type LayerOverlay, styleOf } from "../model/maps.ts";
import { type HalfLook, hasSlices, namedSlots, seenOf, stateIn, type ViewState } from "../model/state.ts";
import { short } from "../model/text.ts";
import { getFile } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { intensity, number, spoken, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { depthWords, paneWords, positionWords } from "../base/readout.ts";
import { writer } from "../panes/map-bar.ts";
import { overlayWords, titleWords } from "../panes/overlay.ts";
import { type Placed, panesPainter } from "../panes/screenshot.ts";
import type { Closer } from "../panes/closer.ts";
import type { MapPane } from "../panes/flat-map.ts";
import type { SliceGroup } from "../panes/slice-group.ts";
import type { SurfacePane } from "../panes/surface-pane.ts";
import type { Store } from "../store/store.ts";
import { captioned, programWords, saveFile } from "./picture-file.ts";

export interface OnScreen {
  readonly shown: ReadyCase;
  readonly state: ViewState;
  readonly panes: HTMLElement;
  readonly surface: SurfacePane;
  readonly slices: SliceGroup;
  readonly closer: Closer | null;
  readonly map: MapPane | null;
}

/** How a file of a case begins: with the first digits of its id. */
export const fileStem = (shown: Pick<ReadyCase, "id">): string => `isocortex-${shown.id.slice(0, 8)}`;

/** What stands below every picture of a case: whose it is, how it is seen, what drew it and what it is not for. */
export async function captionOf(shown: ReadyCase, state: ViewState): Promise<string[]> {
  const { beside, crosshair_mm } = state;
  const words = halfWords(seenOf(state)[0] ?? state);
  const named = namedSlots(state);
  const parts = [
    depthWords(state),
    t(`view.${viewName(state.orientation) ?? "oblique"}`),
    ...(beside
      ? [`${t("caption.left")} ${halfWords(beside).join(", ")}`, `${t("caption.right")} ${words.join(", ")}`]
      : named.length > 0
        ? []
        : words),
    ...named.map((slot) => `${paneWords(state, slot)}: ${halfWords(stateIn(state, slot)).join(", ")}`),
    ...(crosshair_mm ? [t("caption.point", { position: positionWords(crosshair_mm).replaceAll(" · ", " ") })] : []),
  ];
  return [caseIdentity(shown), parts.join(" · "), `${await programWords()} · ${t("notice.long")}`];
}

/** The window, the colours and the layers of a picture, or of a half. */
const halfWords = ({ window, colormap, layer, overlay }: HalfLook): readonly string[] => [
  t("caption.window", { center: intensity(window.center), width: intensity(window.width) }),
  ...(colormap === "grey" ? [] : [t(`colormap.${colormap}`)]),
  ...(layer ? [t("caption.layer", { name: titleWords(layer.about) })] : []),
  ...(overlay ? [aboveWords(overlay)] : []),
];

/** Which layer lies over the picture, and how. */
function aboveWords(overlay: LayerOverlay): string {
  const { threshold, opacity } = overlay;
  const { unit, window, colormap } = styleOf(overlay);
  const written = writer(window);
  const [low, high] = window.map(written);
  const name = overlayWords(overlay);
  const range = colormap === "labels" ? name : t("caption.map", { name, low: low ?? "", high: high ?? "", unit });
  const above = threshold === null ? [] : [t("caption.threshold", { threshold: written(threshold) })];
  return [range.trim(), ...above, t("caption.opacity", { share: number(100 * opacity) })].join(", ");
}

async function pictureOf(
  { shown, state, panes, surface, slices, closer, map }: OnScreen,
  times: number,
): Promise<Blob> {
  const ratio = times * devicePixelRatio;
  const surfaces = async (): Promise<readonly Placed[]> => [
    { element: surface.host, picture: await surface.picture(ratio), isFlipped: false },
  ];
  const placed: readonly (readonly Placed[] | Promise<readonly Placed[]>)[] = closer
    ? [closer.pictures(ratio)]
    : [surfaces(), hasSlices(state) ? slices.pictures(ratio) : [], map?.pictures(ratio) ?? []];
  const [caption, ...all] = await Promise.all([captionOf(shown, state), ...placed]);
  const { clientWidth: width, clientHeight: height } = panes;
  return captioned({ width, height, ratio, caption }, await panesPainter(panes, all.flat()));
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
    // A promise of the picture, because a browser accepts it only during the click.
    await navigator.clipboard.write([new ClipboardItem({ "image/png": pictureOf(view, times) })]);
    return t("export.picture-copied");
  } catch (error) {
    const isForbidden = error instanceof DOMException || typeof ClipboardItem === "undefined";
    return isForbidden ? t("export.no-clipboard") : problemWords(error);
  }
}

/** Saves what the server makes of a case. */
export async function saveMade(
  { shown }: Pick<Store, "shown">,
  name: string,
  make: () => Promise<Blob>,
): Promise<string> {
  try {
    saveFile(await make(), `${fileStem(shown)}${name}`);
    return t("export.file-saved");
  } catch (problem) {
    return problemWords(problem);
  }
}

/** The same of something with findings, once the server has all of them. */
export async function saveWithFindings(store: Store, name: string, make: () => Promise<Blob>): Promise<string> {
  try {
    // A file without the last sentence would look as if it were complete: then there is none.
    await store.findings.sync.flush();
  } catch (problem) {
    return t("findings.unsaved", { why: problemWords(problem) });
  }
  return saveMade(store, name, make);
}

/** The findings as balls and tubes. */
export const findingsStl = ({ id }: ReadyCase): Promise<Blob> => getFile(`${id}/findings`, "model/stl");

/** Saves the isosurface at the depth as a closed mesh. */
export function saveCut({ shown, state: { depth_mm, surface } }: OnScreen): Promise<string> {
  const depth = short(depth_mm, 2);
  const query = new URLSearchParams({ depth_mm: depth, surface, solid: "true" });
  return saveMade({ shown }, `-${surface}-${depth}mm.stl`, () => getFile(`${shown.id}/mesh?${query}`, "model/stl"));
}

/** Saves the case as one file to look at. */
export const saveShared = (store: Store, isNamed: boolean): Promise<string> =>
  saveWithFindings(store, ".html", async () => {
    const reader = await store.reading.reported();
    const asked = { language: spoken(), ...(isNamed && { patient: "true" }), ...(reader && { reading: reader }) };
    return getFile(`${store.shown.id}/share?${new URLSearchParams(asked)}`, "text/html");
  });

/** Copies an address; if the browser forbids this, the address is shown instead. */
export async function copied(address: string): Promise<string> {
  try {
    await navigator.clipboard.writeText(address);
    return t("export.copied");
  } catch {
    return address;
  }
}
