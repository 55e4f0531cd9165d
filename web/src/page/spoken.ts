// What is shown, in words for those who do not see it: depth, direction, and a place with its depth and grey.

import { viewName } from "../model/camera.ts";
import { namedSlots, seenOf, stateIn } from "../model/state.ts";
import type { Vec3 } from "../model/space.ts";
import { number, t } from "../base/i18n.ts";
import { paneWords, positionWords, valueWords } from "../base/readout.ts";
import { lookWords, overlayWords, titleWords } from "../panes/overlay.ts";
import type { Store } from "../store/store.ts";

/** Describes the marked point; without one, the middle of the picture. */
export function spokenWords(store: Store): string {
  const state = store.drawn.peek();
  const { crosshair_mm: marked } = state;
  const [width, height] = store.size;
  const seen = marked ? null : store.surface?.pick(store.view.now, width / 2, height / 2);
  const position = marked ?? seen?.position_in_patient;
  const view = t(`view.${viewName(state.orientation) ?? "oblique"}`);
  const { beside } = state;
  const { layer, overlay } = seenOf(state)[0] ?? state;
  const named = namedSlots(state).map((slot) =>
    t("strip.said", { name: lookWords(stateIn(state, slot)), pane: paneWords(state, slot) }),
  );
  if (beside) named.unshift(t("beside.said", { left: lookWords(beside), right: lookWords({ layer, overlay }) }));
  const layers =
    named.length > 0 ? named : [layer ? titleWords(layer.about) : "", overlay ? overlayWords(overlay) : ""];
  const surface = state.surface === "whole" ? "" : t(`surface.${state.surface}-said`);
  const depth = t("depth.said", { depth: number(state.depth_mm, 1) });
  const words = [depth, view, ...[surface, ...layers].filter(Boolean)];
  const shown = `${words.join(", ")}.`;
  if (!position) return shown;
  return `${shown} ${t(marked ? "said.point" : "said.middle", { place: placeWords(position, store) })}`;
}

function placeWords(position: Vec3, { surface }: Store): string {
  const probed = surface?.probe(position);
  if (!probed || !(probed.depth_mm >= 0) || !Number.isFinite(probed.intensity)) return positionWords(position);
  return t("said.place", {
    position: positionWords(position),
    depth: number(probed.depth_mm, 1),
    values: valueWords(probed.intensity, []),
  });
}
