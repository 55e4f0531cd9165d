// What slices have in common: what lies over them, and what hands do in them.

import type { Sphere } from "../model/case.ts";
import { dragWindow } from "../model/controls.ts";
import type { SliceView } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import { preferences } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";

/** The larger side of a picture of the server. */
export const MOST_PIXELS = 768;
/** The larger side of a slice that is saved. */
export const MOST_SAVED_PIXELS = 4096;

/** Something that is drawn over a slice. */
export interface SliceLayer {
  readonly element: SVGSVGElement;
  /** `isShown`: outlines are not hidden. */
  show(view: SliceView, sphere: Sphere, isShown: boolean): void;
}

/** What a slice of the close-up shows, and how it differs from others under a hand. */
export interface SliceRole {
  /** Distinguishes it from the other slices in its plane. */
  readonly name: string;
  readonly isOpposite: boolean;
  /** Whether layers are shown, not the case alone. */
  readonly isLayer: boolean;
  /** The zoom at first. */
  readonly zoom: number;
  /** The side on which a place is. */
  words(position_in_patient: Vec3): string;
  /** A drag with the right button. */
  window(move: Vec2): void;
  /** The cross is put here; `isDone` when the hand has left. */
  move(position_in_patient: Vec3, isDone: boolean): void;
  /** The wheel, a key or the slider brings another slice, and the cross with it. */
  scroll(position_in_patient: Vec3): void;
}

/** Hears that a hand has enlarged a slice: the others follow. */
export type Zoomed = (from: string, zoom: number) => void;

/** A drag with the right button changes the window of what is shown. */
export const dragTheWindow = ({ view, shown }: Store, move: Vec2): void =>
  view.change(dragWindow(view.now, shown, move, preferences.peek().drag));
