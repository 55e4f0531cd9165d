// What panes have in common: what hands do in them.

import { dragWindow, wheelZoom } from "../model/controls.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { Placing } from "../model/slice-geometry.ts";
import { type Place, lookAt } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import { preferences } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";

export const MOST_PIXELS = 768;
export const MOST_SAVED_PIXELS = 4096;

/** What a slice of the close-up shows, and how it differs from others under a hand. */
export interface SliceRole {
  /** Distinguishes it from the other slices in its plane. */
  readonly name: string;
  readonly isOpposite: boolean;
  /** Whether layers are shown, not the case alone. */
  readonly isLayer: boolean;
  readonly zoom: number;
  /** The side on which a place is. */
  words(position_in_patient: Vec3): string;
  /** The cross is put here; `isDone` when the hand has left. */
  move(position_in_patient: Vec3, isDone: boolean): void;
  /** The wheel, a key or the slider brings another slice, and the cross with it. */
  scroll(position_in_patient: Vec3): void;
}

/** Hears that a hand has placed a slice: the others follow. */
export type PlacedByHand = (from: string, placing: Placing, isZoomed: boolean) => void;

/** A drag with the right button changes the window of what a pane shows. */
export function dragTheWindow({ view, shown }: Store, move: Vec2, pane: Place): void {
  const seen = { ...view.now, ...lookAt(view.now, pane) };
  view.changeLook(dragWindow(seen, shown, move, preferences.peek().drag), false, pane);
}

/** The wheel zooms or goes to another depth, as is preferred; with alt it does the other. A pinch on a touchpad comes with the control key. */
export function turnTheWheel(
  store: Store,
  [pixels, notches, event]: readonly [number, number, WheelEvent],
  zoom: (factor: number) => void,
): void {
  const isDepth = !event.ctrlKey && event.altKey !== (preferences.peek().wheel === "depth");
  if (!isDepth) zoom(wheelZoom(event.ctrlKey ? pixels * 5 : pixels));
  else if (notches !== 0) perform(store, { kind: "depth", steps: notches, fine: event.shiftKey });
}
