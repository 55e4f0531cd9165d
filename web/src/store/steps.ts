// The steps of a reading: the views of a protocol, gone through one after the other.

import { number, t } from "../base/i18n.ts";
import { viewName } from "../model/camera.ts";
import { isReady } from "../model/layers.ts";
import { readOverlay } from "../model/maps.ts";
import { missingOf, recalled } from "../model/saved-layouts.ts";
import { PROTOCOLS, type Protocol, type Step, isProtocol } from "../model/steps.ts";
import { clampDepth } from "../model/state.ts";
import { isHalf } from "../model/surfaces.ts";
import { note } from "./announce.ts";
import { goToRow } from "./bring.ts";
import { preferences, unfold } from "./preferences.ts";
import { layersOf, ownSteps } from "./saved-layouts.ts";
import type { Store } from "./store.ts";

/** The protocols to choose from; one's own once it has steps. */
export const protocols = (): readonly Protocol[] =>
  [...Object.keys(PROTOCOLS), ...(ownSteps.value.length > 0 ? ["own"] : [])].filter(isProtocol);

/** The protocol that is chosen. */
export const protocolNow = (): Protocol => protocols().find((one) => one === preferences.value.protocol) ?? "complete";

/** Its steps. */
export function stepsNow(): readonly Step[] {
  const protocol = protocolNow();
  return protocol === "own" ? ownSteps.value : PROTOCOLS[protocol];
}

export function stepWords({ shows, layout, surface = "whole", view, depth_mm = 0, name, series }: Step): string {
  // One's own has the name that was typed.
  if (series) return name;
  if (shows) return t(`step.${shows}`);
  const seen = isHalf(surface) ? `${t(`surface.${surface}`)} · ${t("surface.inner")}` : t(`view.${view ?? "oblique"}`);
  return `${layout === "map" || layout === "mirror" ? t(`layout.${layout}`) : seen} · ${number(depth_mm)} mm`;
}

/** The newest FLAIR that is ready. */
const flairOf = ({ caseLayers }: Store): string | null =>
  caseLayers.list.value?.layers.findLast((one) => one.contrast === "flair" && isReady(one))?.id ?? null;

/** Whether the case has what a step shows. */
export function canShow(store: Store, { shows, surface = "whole", series = {} }: Step): boolean {
  const layers = store.caseLayers.list.value?.layers ?? [];
  const { state } = layers[0] ?? {};
  if (missingOf({ series }, layers).length > 0) return false;
  if (shows === "flair") return flairOf(store) !== null;
  if (shows === "places") return state !== "undefined" && state !== "off";
  return surface === "whole" || store.refusal.value === "";
}

/** The step that was gone to, as long as it is on the screen. Places and findings are, wherever their rows lead. */
export function stepOnScreen(store: Store): string | null {
  const { step, view, shown } = store;
  const gone = stepsNow().find(({ name }) => name === step.value);
  if (!gone) return null;
  const { layout, surface, orientation, depth_mm, layer, overlay } = view.state.value;
  const isThere =
    layout === gone.layout &&
    surface === gone.surface &&
    (gone.shows !== "flair" || layer?.id === flairOf(store)) &&
    (!gone.series || (readOverlay(gone.map ?? "")?.overlay.name ?? "") === (overlay?.name ?? "")) &&
    depth_mm === clampDepth(gone.depth_mm ?? depth_mm, shown) &&
    // From a head that was turned freely, the direction was not saved.
    (gone.view === null || viewName(orientation) === gone.view);
  return isThere || gone.shows === "places" || gone.shows === "findings" ? gone.name : null;
}

/** Goes to the next step, or to the one before. What the case cannot show is passed over, and said. */
export function walk(store: Store, by: number): void {
  const steps = stepsNow();
  const at = steps.findIndex(({ name }) => name === store.step.peek());
  const skipped: string[] = [];
  let to = at < 0 ? 0 : at + by;
  for (let step = steps[to]; step && !canShow(store, step); step = steps[(to += by)]) skipped.push(stepWords(step));
  const step = steps[to];
  const words = skipped.length > 0 ? t("step.skipped", { names: skipped.join(", ") }) : "";
  if (step) void takeStep(store, step, words);
  else note(`${words} ${t(by > 0 ? "step.last" : "step.first")}`.trim());
}

export async function takeStep(store: Store, step: Step, skipped = ""): Promise<void> {
  const { view, shown, layers, rows, places } = store;
  const { name, shows } = step;
  const steps = stepsNow();
  store.step.value = name;
  store.large.value = null;
  // The mark stays, and turns no step.
  const change = recalled(
    { series: {}, plane: null, ...step },
    { ...view.now, crosshair_mm: null },
    shown,
    layersOf(store),
  );
  const texture = layers.asGrey(shows === "flair" ? flairOf(store) : null);
  store.change({ beside: null, swipe: null, zoom: 1, pan_mm: [0, 0], ...texture, ...change }, true);
  store.looks.value += 1;
  const place = { number: number(steps.indexOf(step) + 1), count: number(steps.length), name: stepWords(step) };
  note(`${skipped} ${t("step.said", place)}`.trim());
  if (shows !== "places" && shows !== "findings") return;
  store.task.value = "read";
  unfold("panel.list", true);
  if (shows === "findings") return;
  const [first] = places.lists;
  if (first && !first.isAsked) await places.ask(first);
  const row = rows.inSight.peek().find((one) => one.place) ?? (await rows.next(0));
  // The places may come after the next step.
  if (store.isOver || store.step.peek() !== name) return;
  if (typeof row === "string") note(row);
  else goToRow(store, row);
}
