// Two cases that are looked at side by side: from the state of one to what the other takes over.

import type { ReadyCase } from "./case.ts";
import {
  type Affine,
  type Vec3,
  add,
  clamp,
  compose,
  fromRows,
  inverted,
  rotate,
  subtract,
  transform,
  unit,
} from "./space.ts";
import { type ViewState, PAN_LIMIT_MM, ZOOM_RANGE, clampDepth } from "./state.ts";

export type Linked = Pick<
  ViewState,
  "depth_mm" | "orientation" | "zoom" | "pan_mm" | "crosshair_mm" | "layout" | "plane" | "convention"
> &
  Partial<Pick<ViewState, "window">>;

export interface Shown {
  readonly shown: ReadyCase;
  readonly state: ViewState;
}

/** The turn of a rigid transform. */
function turnOf(affine: Affine): ReturnType<typeof fromRows> {
  const [right, up, towards] = affine.slice(0, 3).map((row) => row.slice(0, 3) as unknown as Vec3);
  return fromRows(right ?? [1, 0, 0], up ?? [0, 1, 0], towards ?? [0, 0, 1]);
}

/**
 * What `other` takes over from `one`, so that the same place is seen from the same side, at the same depth, as large,
 * and at the same place of a pane of the same size. `one_from_other` is rigid, in LPS mm. Windows follow in shares of
 * the window that each case has at first; the window of a layer belongs to the layer.
 */
export function linked(one: Shown, other: Shown, one_from_other: Affine): Linked {
  const { state } = one;
  const [own, its] = [one.shown.envelope_sphere, other.shown.envelope_sphere];
  const turned = compose(state.orientation, turnOf(one_from_other));
  const offset = subtract(transform(one_from_other, its.center_in_patient), own.center_in_patient);
  const [x, y] = add(rotate(state.orientation, offset), [...state.pan_mm, 0]);
  const bounded = (mm: number): number => clamp(mm, -PAN_LIMIT_MM, PAN_LIMIT_MM);
  const other_from_one = inverted(one_from_other);
  const [from, to] = [one.shown.intensity.window, other.shown.intensity.window];
  const isOfCases = !state.layer && !other.state.layer;
  return {
    depth_mm: clampDepth(state.depth_mm, other.shown),
    orientation: unit(turned) ?? state.orientation,
    zoom: clamp((state.zoom * its.radius_mm) / own.radius_mm, ...ZOOM_RANGE),
    pan_mm: [bounded(x), bounded(y)],
    crosshair_mm: state.crosshair_mm && other_from_one && transform(other_from_one, state.crosshair_mm),
    layout: state.layout,
    plane: state.plane,
    convention: state.convention,
    ...(isOfCases && {
      window: {
        center: to.center + ((state.window.center - from.center) * to.width) / from.width,
        width: Math.max((state.window.width * to.width) / from.width, 1),
      },
    }),
  };
}
