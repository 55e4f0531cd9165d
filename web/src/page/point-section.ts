// What is known of the marked point, in words and as a chart.

import { h, quiet, setText } from "../base/dom.ts";
import type { ReadyCase } from "../model/case.ts";
import type { Picked, Probed } from "../model/points.ts";
import type { Vec3 } from "../model/space.ts";
import { number, t } from "../base/i18n.ts";
import { depthAtWords, positionWords, voxelAt } from "../base/readout.ts";
import type { Actions } from "./actions.ts";
import { button, row } from "./fields.ts";

/** The point in words. */
export interface PointWords {
  readonly position: string;
  readonly voxel: string;
  readonly depth: string;
  readonly intensity: string;
}

const LABELS = {
  position: "point.position",
  voxel: "point.voxel",
  depth: "point.depth-label",
  intensity: "point.intensity",
} as const;

export class PointSection {
  readonly parts: readonly HTMLElement[];
  readonly #words = h("dl", { class: "point" });
  readonly #tools: HTMLElement;
  readonly #across: HTMLButtonElement;
  readonly #hint = quiet(t("point.hint"));
  readonly #profile = h("div", {});
  /** Where the chart stands, unless it stands beside a place of the list. */
  readonly #home = h("div", {}, this.#profile);

  constructor(actions: Actions) {
    this.#across = button(t("across.show"), () => actions.command({ kind: "across" }), { "aria-keyshortcuts": "x" });
    this.#tools = row(
      button(t("closer.look"), () => actions.command({ kind: "closer" }), { "aria-keyshortcuts": "z" }),
      this.#across,
      button(t("point.turn"), () => actions.turnToCross()),
      button(t("point.depth"), () => actions.depthOfCross()),
      button(t("point.forget"), () => actions.forgetCross()),
    );
    const mark = row(button(t("point.mark"), () => actions.command({ kind: "mark" })));
    this.parts = [this.#hint, this.#words, this.#tools, this.#home, mark];
    this.show(null);
  }

  /** Shows a point; without one there is no chart either. */
  show(words: PointWords | null): void {
    const keys = Object.keys(LABELS) as (keyof PointWords)[];
    const rows = words ? keys.map((key) => [h("dt", {}, t(LABELS[key])), h("dd", { class: key }, words[key])]) : [];
    this.#words.replaceChildren(...rows.flat());
    this.#words.hidden = !words;
    this.#tools.hidden = !words;
    this.#hint.hidden = words !== null;
    setText(this.#hint, t("point.hint"));
    if (!words) this.plot(null);
  }

  /** Whether the slice across the sulcus is shown. */
  across(isShown: boolean): void {
    this.#across.setAttribute("aria-pressed", String(isShown));
  }

  /** Shows the chart of a profile; null: of none. */
  plot(profile: HTMLElement | null): void {
    // The table stays open, whatever depth is gone to.
    const isOpen = this.#profile.querySelector("details")?.open ?? false;
    this.#profile.replaceChildren(...(profile ? [profile] : []));
    const table = this.#profile.querySelector("details");
    if (table) table.open = isOpen;
  }

  /** Moves the chart to another place; null: back. */
  stand(place: HTMLElement | null): void {
    const host = place ?? this.#home;
    if (this.#profile.parentElement !== host) host.append(this.#profile);
  }

  /** Explains why no point was marked. */
  hint(words: string): void {
    setText(this.#hint, words);
    this.#hint.hidden = false;
  }
}

/** A position in words, with what is known of it. */
export function pointWords(
  shown: ReadyCase,
  position: Vec3,
  { depth_mm }: Partial<Picked | Probed>,
  values: string,
): PointWords {
  const voxel = voxelAt(shown, position);
  return {
    position: positionWords(position),
    voxel: voxel ? voxel.map((part) => number(part)).join(", ") : t("point.outside"),
    depth: depthAtWords(depth_mm),
    intensity: values,
  };
}
