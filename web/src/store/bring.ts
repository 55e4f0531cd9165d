// Bringing places to the viewer: on the part of the brain that is shown if they lie there, on an inner side, or in slices.

import { t } from "../base/i18n.ts";
import { DEEP_MM, broughtInside, broughtTo, innerSideOf } from "../model/commands.ts";
import type { Change } from "../model/controls.ts";
import { findingOfPlace, middleOf } from "../model/findings.ts";
import { type ListingMap, firstOverlay } from "../model/maps.ts";
import { distance_mm } from "../model/midsagittal.ts";
import type { Vec3 } from "../model/space.ts";
import { type Layout, hasSlices } from "../model/state.ts";
import { isHalf } from "../model/surfaces.ts";
import { announce } from "./announce.ts";
import type { Row } from "./rows.ts";
import type { Store } from "./store.ts";

/**
 * Brings a place to the viewer and marks it: at its depth below the envelope, or at that below the surface of the part that is
 * shown; without a depth, in slices.
 */
export function bring(store: Store, position: Vec3, depth_mm: number | null): void {
  const { view, shown, surface } = store;
  const { layout } = view.now;
  store.sweep.stop();
  store.awaited = null;
  if (depth_mm === null) bringSlices(store, position, layout);
  else {
    // The depth of a finding may be that below a half.
    const whole_mm = surface?.wholeDepth(position) ?? depth_mm;
    const half = layout === "map" ? null : innerSideOf(position, whole_mm, shown);
    if (half) bringInside(store, { position, depth_mm: whole_mm, half }, layout, true);
    else {
      const isDeep = whole_mm > DEEP_MM;
      // A part that is still being fetched is drawn once the place is shown.
      const isPart = (surface?.deepest_mm ?? null) !== null;
      const own_mm = isPart ? (surface?.probe(position)?.depth_mm ?? NaN) : depth_mm;
      const at = broughtTo(position, own_mm >= 0 ? own_mm : depth_mm, layout, shown);
      const slices = isDeep && !hasSlices({ layout }) && layout !== "closer" && layout !== "map";
      const beside = slices ? ({ layout: layout === "mirror" ? "both" : "slices" } as const) : {};
      view.change({ ...at, ...(own_mm >= 0 ? {} : { surface: "whole" }), ...beside }, true);
      if (isDeep) announce(t("point.deep"));
    }
  }
  if (view.now.layout === "closer") showEvidence(store);
}

/**
 * Shows in a close-up of a finding, or of a listed place, if no layer is chosen, beside the case itself that for which the place
 * was listed: the FLAIR, or the map of thickness. Blur is judged by the case itself. When the close-up is left, so is this.
 */
export function showEvidence(store: Store): void {
  const { layer, overlay, window } = store.view.now;
  const evidence = layer || overlay ? null : evidenceOf(store);
  if (!evidence) return;
  store.beforeCloser = { ...store.beforeCloser, layer, overlay, window };
  store.view.change(evidence);
}

function evidenceOf({ layers, places, caseLayers, findings, view }: Store): Change | null {
  const { crosshair_mm: mark } = view.now;
  const finding = mark && findingOfPlace(findings.list.peek(), mark);
  const isOf = (map: ListingMap): boolean =>
    finding ? finding.from_map === map : places.lists.some((list) => list.map === map && list.open.peek() !== null);
  const flair = isOf("flair") ? caseLayers.ready("flair")?.of_layer : undefined;
  if (flair) return layers.asGrey(flair);
  return isOf("thickness") && caseLayers.ready("thickness") ? { overlay: firstOverlay("thickness") } : null;
}

/** Brings what a row of the list is about to the viewer, and unfolds it. */
export function goToRow(store: Store, { key, place, finding }: Row): void {
  store.rows.reached.value = key;
  if (place) bring(store, place.position_in_patient, place.depth_mm);
  else if (finding) bring(store, middleOf(finding), finding.depth_mm);
  // The mark unfolds what is there; of several, this is the row that was gone to.
  if (finding) store.findings.unfold(finding);
  else store.findings.open.value = null;
}

/** More is known of the surface: a place that waits for a half is brought to its depth there, and no depth is below its deepest. */
export function settle(store: Store): void {
  settleAwaited(store);
  const { surface, view } = store;
  // Below its deepest place a part shows nothing.
  const deepest_mm = surface?.deepest_mm ?? null;
  if (deepest_mm !== null && view.now.depth_mm > deepest_mm)
    view.change({ depth_mm: Math.floor(deepest_mm * 100) / 100 });
}

function settleAwaited(store: Store): void {
  const { crosshair_mm, surface, layout } = store.view.now;
  const { awaited } = store;
  if (!awaited || crosshair_mm !== awaited.position || !isHalf(surface)) store.awaited = null;
  else if (store.surface?.pointsOf(surface)) bringInside(store, { ...awaited, half: surface }, layout, false);
}

/** Shows the whole brain in the place of a part that cannot be shown, and says why. */
export function leavePart(store: Store, problem: unknown): void {
  store.refusePart(problem);
  const { awaited, view, shown } = store;
  store.awaited = null;
  if (awaited && awaited.position === view.now.crosshair_mm)
    view.change({ ...broughtTo(awaited.position, awaited.depth_mm, "slices", shown), surface: "whole" });
  else if (view.now.surface !== "whole") view.change({ surface: "whole" });
}

/** Shows a place whose depth is not known, at the depth that is shown. */
function bringSlices({ view, shown }: Store, position: Vec3, layout: Layout): void {
  const shownIn = hasSlices({ layout }) || layout === "closer" ? layout : "slices";
  view.change(broughtTo(position, view.now.depth_mm, shownIn, shown), true);
  announce(t("point.cut"));
}

/** Shows a place on the inner side of a half, at once at about its depth, and at its depth as soon as the half is here. */
function bringInside(
  store: Store,
  { position, depth_mm, half }: { position: Vec3; depth_mm: number; half: "left" | "right" },
  layout: Layout,
  isStep: boolean,
): void {
  const { view, shown } = store;
  const own_mm = store.surface?.pointsOf(half)?.probe(position).depth_mm;
  // It is not of the half after all.
  if (own_mm !== undefined && !(own_mm >= 0)) {
    store.awaited = null;
    const at = broughtTo(position, depth_mm, hasSlices({ layout }) ? layout : "slices", shown);
    view.change({ ...at, surface: "whole" }, isStep);
    return announce(t("point.deep"));
  }
  store.awaited = own_mm === undefined ? { position, depth_mm } : null;
  const from_plane_mm = Math.abs(distance_mm(position, shown.midsagittal));
  const place = { position, half, depth_mm: own_mm ?? from_plane_mm };
  view.change(broughtInside(place, { zoom: view.now.zoom, layout }, shown), isStep);
  if (isStep) announce(t(half === "left" ? "point.inner-left" : "point.inner-right"));
}
