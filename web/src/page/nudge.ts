// Moving a layer by hand: in steps, in the page alone, until it is added as another layer.

import { getFile } from "../base/api.ts";
import { h, iconButton, status, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { positionWords } from "../base/readout.ts";
import { fromColumns, product, scaleThenMove } from "../model/affine.ts";
import type { ReadyCase } from "../model/case.ts";
import { isLayerId } from "../model/maps.ts";
import { type Affine, type Vec3, rotate, scale, subtract, transform, turnAbout } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import type { CaseLayers } from "./case-layers.ts";
import { button, row } from "./fields.ts";
import { sendLayer } from "./layer-form.ts";
import { freeName } from "./upload-files.ts";

const STEP_MM = 0.5;
const STEP_DEGREES = 0.5;
const DEGREE_RAD = Math.PI / 180;
const AXES: readonly Vec3[] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];
/** The directions of steps: back and forth along the axes, or about them. */
const LETTERS = ["R", "L", "A", "P", "I", "S"] as const;
const TURNS = ["up", "down", "undo", "redo", "left", "right"] as const;
/** The place of a key's direction among the letters, and with shift among the turns. */
const KEYS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [0, 4],
  ArrowRight: [1, 5],
  ArrowUp: [2, 0],
  ArrowDown: [3, 1],
  PageDown: [4, 2],
  PageUp: [5, 3],
};

interface NudgeListener {
  /** The layer lies elsewhere. */
  moved(): void;
  /** Shows a layer in the place of the one that was moved. */
  take(id: string): void;
}

/** A step in one of the six directions, or about one of the three axes through a point. */
export function stepOf(direction: number, turns: boolean, center: Vec3): Affine {
  const axis = AXES[direction >> 1] ?? center;
  const sign = direction % 2 === 0 ? -1 : 1;
  if (!turns) return scaleThenMove([1, 1, 1], scale(axis, sign * STEP_MM));
  const turn = turnAbout(axis, sign * STEP_DEGREES * DEGREE_RAD);
  const [x, y, z] = AXES.map((one) => rotate(turn, one)) as [Vec3, Vec3, Vec3];
  return fromColumns(x, y, z, subtract(center, rotate(turn, center)));
}

/** The angle by which a rigid transform turns, in degrees. */
export function angleOf(affine: Affine): number {
  const trace = [0, 1, 2].reduce((sum, axis) => sum + (affine[axis]?.[axis] ?? 0), 0);
  return Math.acos(Math.min((trace - 1) / 2, 1)) / DEGREE_RAD;
}

export class Nudge {
  readonly element: HTMLDetailsElement;
  readonly #shown: ReadyCase;
  readonly #layers: CaseLayers;
  readonly #listener: NudgeListener;
  readonly #summary = h("summary", {}, t("nudge.label"));
  readonly #words = status();
  readonly #ends: HTMLElement;
  #state: ViewState | null = null;
  #id: string | null = null;
  #moved: Affine | null = null;

  constructor(shown: ReadyCase, layers: CaseLayers, listener: NudgeListener) {
    this.#shown = shown;
    this.#layers = layers;
    this.#listener = listener;
    this.#ends = row(
      button(t("nudge.add"), () => void this.#add()),
      button(t("nudge.drop"), () => this.#put(null)),
    );
    this.element = h(
      "details",
      { class: "nudge", hidden: true, keydown: (event: KeyboardEvent) => this.#key(event) },
      this.#summary,
      row(
        ...LETTERS.map((letter, at) =>
          button(letter, () => this.#step(at, false), { "aria-label": t(`shift.${letter}`) }),
        ),
      ),
      row(...TURNS.map((turn, at) => iconButton(turn, t(`tilt.${turn}`), () => this.#step(at, true)))),
      this.#ends,
      this.#words,
    );
    this.#put(null);
  }

  show(state: ViewState): void {
    const { layer, overlay } = state;
    const id = layer?.id ?? (overlay && isLayerId(overlay.name) ? overlay.name : null);
    this.#state = state;
    this.element.hidden = id === null;
    if (id !== this.#id) this.#put(null);
    this.#id = id;
  }

  /** Opens the part, so that keys move the layer. */
  begin(): void {
    this.element.open = true;
    this.#summary.focus();
  }

  /** A state with its layer where it was moved to. */
  placed(state: ViewState): ViewState {
    const moved = this.#moved;
    const { layer, overlay } = state;
    if (!moved) return state;
    const origin = t("nudge.origin");
    if (layer) return { ...state, layer: { ...layer, moved, about: { title: "", ...layer.about, origin } } };
    return overlay?.about ? { ...state, overlay: { ...overlay, moved, about: { ...overlay.about, origin } } } : state;
  }

  #key(event: KeyboardEvent): void {
    const found = KEYS[event.key];
    if (!found || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const isFlipped = this.#state?.convention === "neurological";
    const direction = found[event.shiftKey ? 1 : 0];
    // Left and right are those of the slices.
    this.#step(isFlipped && found[0] < 2 ? direction ^ 1 : direction, event.shiftKey);
  }

  #step(direction: number, turns: boolean): void {
    const center = this.#shown.envelope_sphere.center_in_patient;
    const step = stepOf(direction, turns, center);
    this.#put(this.#moved ? product(step, this.#moved) : step);
  }

  #put(moved: Affine | null): void {
    this.#moved = moved;
    this.#ends.hidden = !moved;
    const center = this.#shown.envelope_sphere.center_in_patient;
    const shift = moved && positionWords(subtract(transform(moved, center), center));
    tell(this.#words, moved ? t("nudge.moved", { shift: shift ?? "", angle: number(angleOf(moved), 1) }) : "");
    this.#listener.moved();
  }

  /** Sends the voxels back with the matrix, and shows the new layer once it is ready. */
  async #add(): Promise<void> {
    const layer = this.#id === null ? null : this.#layers.ready(this.#id);
    if (!layer || !this.#moved) return;
    const { id, name, kind, unit, labels } = layer;
    tell(this.#words, t("export.working"));
    try {
      const file = new File([await getFile(`${this.#shown.id}/layers/${id}/nifti`)], "layer.nii.gz");
      const wish = { name: freeName(name.slice(0, 60), this.#layers.names), kind, unit, transform: this.#moved };
      const names = labels?.map((one) => `${one.value} ${one.name}\n`) ?? [];
      const quietly = [new AbortController().signal, () => {}] as const;
      const { created } = await sendLayer(
        this.#shown.id,
        [file],
        wish,
        names.length > 0 ? new Blob(names) : null,
        quietly,
      );
      await this.#layers.again();
      if (this.#id === id) this.#listener.take(created.id);
      tell(this.#words, t("layer.sent", { name: created.name }));
    } catch (problem) {
      tell(this.#words, problemWords(problem));
    }
  }
}
