// What is shown, in words for those who do not see it: depth, direction, and a place with its depth and grey.

import { viewName } from "../model/camera.ts";
import type { ChangingCommand } from "../model/controls.ts";
import type { Picked, Probed } from "../model/points.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import { number, t } from "../base/i18n.ts";
import { positionWords, valueWords } from "../base/readout.ts";
import { lookWords, overlayWords, titleWords } from "../panes/overlay.ts";

/** What is asked about places. */
export interface Places {
  size(): Vec2;
  pick(place: Vec2): Picked | null;
  probe(position: Vec3): Probed | null;
}

/** Describes the marked point; without one, the middle of the picture. */
function spokenWords(state: ViewState, places: Places): string {
  const { crosshair_mm: marked } = state;
  const [width, height] = places.size();
  const position = marked ?? places.pick([width / 2, height / 2])?.position_in_patient ?? null;
  const view = t(`view.${viewName(state.orientation) ?? "oblique"}`);
  const { beside } = state;
  const layers = beside
    ? [t("beside.said", { left: lookWords(beside), right: lookWords(state) })]
    : [state.layer ? titleWords(state.layer.about) : "", state.overlay ? overlayWords(state.overlay) : ""];
  const surface = state.surface === "whole" ? "" : t(`surface.${state.surface}-said`);
  const depth = t("depth.said", { depth: number(state.depth_mm, 1) });
  const words = [depth, view, ...[surface, ...layers].filter(Boolean)];
  const shown = `${words.join(", ")}.`;
  if (!position) return shown;
  return `${shown} ${t(marked ? "said.point" : "said.middle", { place: placeWords(position, places) })}`;
}

/** The words that announce a command at once; null if the description of the view is enough. */
export function spokenCommand(command: ChangingCommand): string | null {
  if (command.kind === "view") return t(`view.${command.name}`);
  if (command.kind === "window") return t("window.said", { name: t(`window.${command.preset}`) });
  return null;
}

function placeWords(position: Vec3, places: Places): string {
  const probed = places.probe(position);
  if (!probed || !(probed.depth_mm >= 0) || !Number.isFinite(probed.intensity)) return positionWords(position);
  return t("said.place", {
    position: positionWords(position),
    depth: number(probed.depth_mm, 1),
    values: valueWords(probed.intensity, []),
  });
}

/** Reads out what is shown, if that is not what was said before. */
export class Speaker {
  readonly #announce: (words: string) => void;
  /** Null before the first picture. */
  #said: string | null = null;

  constructor(announce: (words: string) => void) {
    this.#announce = announce;
  }

  /** The words of a state, which are read out where they are new; at first the page has enough to say. */
  say(state: ViewState, places: Places): string {
    const words = spokenWords(state, places);
    if (this.#said !== null && this.#said !== words) this.#announce(words);
    this.#said = words;
    return words;
  }
}
