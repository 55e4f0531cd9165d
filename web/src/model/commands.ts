// What a command makes of a state: pure.

import { facing, mirrored, outwardAt, towardsViewer } from "./camera.ts";
import type { ReadyCase } from "./case.ts";
import { type Change, type ChangingCommand, deepen, invert, lookFrom, pan, turn, zoomAt } from "./controls.ts";
import { firstOverlay, toggled } from "./maps.ts";
import { distance_mm, sideOf, sideSeen } from "./midsagittal.ts";
import { type Vec2, type Vec3, rotate, scale, subtract } from "./space.ts";
import { isHalf, mirroredSurface, nextSurface } from "./surfaces.ts";
import { type Layout, type ViewState, clampDepth, firstState, isMirrored, presetWindow, textureOf } from "./state.ts";

/** `size` is that of the pane, in pixels; `isStep`: Back undoes it. */
export function changeOf(
  command: ChangingCommand,
  state: ViewState,
  shown: ReadyCase,
  size: Vec2,
): { readonly change: Change; readonly isStep: boolean } {
  switch (command.kind) {
    case "depth":
      return { change: deepen(state, shown, command.steps, command.fine), isStep: false };
    case "turn":
      return { change: turn(state, inThousandths(command.move, size), size), isStep: false };
    case "pan":
      return { change: pan(state, shown, inThousandths(command.move, size), size), isStep: false };
    case "zoom":
      return { change: zoomAt(state, shown, command.factor, [size[0] / 2, size[1] / 2], size), isStep: false };
    case "view":
      return { change: lookFrom(command.name), isStep: true };
    case "window":
      return { change: { window: presetWindow(command.preset, textureOf(state, shown)) }, isStep: true };
    case "map":
      return { change: { overlay: toggled(state.overlay, firstOverlay(command.name)) }, isStep: true };
    case "surface":
      return { change: { surface: command.name ?? nextSurface(state.surface) }, isStep: true };
    case "invert":
      return { change: invert(state), isStep: true };
    case "reset": {
      const { surface, layout, plane, way, convention, outlines_mm, averages_shallow } = state;
      return {
        change: { ...firstState(shown), surface, layout, plane, way, convention, outlines_mm, averages_shallow },
        isStep: true,
      };
    }
  }
}

/** A move in thousandths of the pane's smaller side, in pixels. */
function inThousandths([x, y]: Vec2, size: Vec2): Vec2 {
  const unit = Math.min(...size) / 1000;
  return [x * unit, y * unit];
}

/**
 * The change to a layout. Beside the mirrored half the hemisphere of the marked point is shown as it was acquired;
 * without one, the left hemisphere.
 */
export function laidOut(layout: Layout, state: ViewState, shown: ReadyCase): Change {
  const { orientation, crosshair_mm, surface } = state;
  // What a close-up has beside its layer is its own.
  if (!isMirrored({ layout })) return state.layout === "closer" ? { layout, beside: null } : { layout };
  const plane = shown.midsagittal;
  const marked = crosshair_mm ? sideOf(crosshair_mm, plane) : "middle";
  const isTold = marked === "left" || marked === "right";
  // One half alone shows its own side, also from within.
  const seen = isHalf(surface) ? surface : sideSeen(towardsViewer(orientation), plane);
  const isInSight = seen === (isTold ? marked : isHalf(surface) ? surface : "left");
  const turn = crosshair_mm && isTold ? turnedTo(crosshair_mm, shown) : lookFrom("left");
  return { layout, beside: null, ...(isInSight ? {} : turn) };
}

/** The change after which the other hemisphere is shown as it was acquired, where the mirrored half shows it flipped. */
export const otherSide = (state: ViewState, shown: ReadyCase): Change => ({
  ...mirrored(state, shown.midsagittal, shown.envelope_sphere),
  surface: mirroredSurface(state.surface),
});

/** The change that brings a position to the viewer; none in the middle itself, which has no side. */
export function turnedTo(position: Vec3, shown: ReadyCase): Change {
  const outward = outwardAt(position, shown.envelope_sphere);
  return Math.hypot(...outward) > 0.5 ? { orientation: facing(outward), pan_mm: [0, 0] } : {};
}

/**
 * The change that brings a position of the cut at `depth_mm` to the viewer and marks it, in a layout. Beside the
 * mirrored half its hemisphere is shown as it was acquired, and both halves have it in the middle.
 */
export function broughtTo(position: Vec3, depth_mm: number, layout: Layout, shown: ReadyCase): Change {
  return {
    ...turnedTo(position, shown),
    ...(isMirrored({ layout }) && { beside: null }),
    // As exact as the lists say it.
    depth_mm: clampDepth(Math.round(10 * depth_mm) / 10, shown),
    crosshair_mm: position,
    layout,
  };
}

/** Deeper than this, the cut through the whole brain meets most of the cortex slantwise. */
export const DEEP_MM = 30;

/**
 * The half on whose inner side a place is seen, because it is by far nearer to the plane between the halves than to the dura outside, or
 * nearer at all if it is too deep for the whole brain; null if it is not.
 */
export function innerSideOf(position: Vec3, depth_mm: number, shown: ReadyCase): "left" | "right" | null {
  const plane = shown.midsagittal;
  if (plane.doubtful) return null;
  const left_mm = distance_mm(position, plane);
  const reach_mm = depth_mm > DEEP_MM ? depth_mm : depth_mm / 2;
  if (!(Math.abs(left_mm) < reach_mm)) return null;
  return left_mm > 0 ? "left" : "right";
}

/** The change that shows the inner side of a half, with a place in the middle if it is zoomed, at `depth_mm` below its surface. */
export function broughtInside(
  { position, half, depth_mm }: { readonly position: Vec3; readonly half: "left" | "right"; readonly depth_mm: number },
  { zoom, layout }: Pick<ViewState, "zoom" | "layout">,
  shown: ReadyCase,
): Change {
  // The other half is away, and the viewer in its place.
  const orientation = facing(scale(shown.midsagittal.normal, half === "left" ? -1 : 1));
  const [x, y] = rotate(orientation, subtract(position, shown.envelope_sphere.center_in_patient));
  return {
    ...broughtTo(position, depth_mm, layout, shown),
    orientation,
    pan_mm: zoom > 1 ? [-x, -y] : [0, 0],
    surface: half,
  };
}
