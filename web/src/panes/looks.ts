// What of a state the painter draws.

import type { ReadyCase } from "../model/case.ts";
import { type Centres, discsOf, surfaceOf } from "../model/flat-map.ts";
import { type LayerOverlay, isDiverging, styleOf } from "../model/maps.ts";
import { type SliceView, isFlipped, sliceCamera, sliceCenter } from "../model/slice-geometry.ts";
import type { Vec2 } from "../model/space.ts";
import {
  type ViewState,
  type HalfLook,
  bareOf,
  edgesLayer,
  halfOf,
  isHalved,
  isMirrored,
  layersOf,
  leftOf,
  lookNumbers,
  partsOf,
  slabOf,
  viewSize,
} from "../model/state.ts";
import { mirroredSurface } from "../model/surfaces.ts";
import { colorRow } from "../gl/colors.ts";
import type { Painter } from "../gl/painter.ts";
import type { Pane, SliceLook } from "../gl/scene.ts";
import type { Look, OverlayLook } from "../gl/uniforms.ts";

function overlayLook(overlay: LayerOverlay): OverlayLook {
  const { name, threshold, opacity, moved } = overlay;
  const style = styleOf(overlay);
  return {
    name,
    moved,
    window: style.window,
    threshold,
    opacity,
    color_row: colorRow(style.colormap),
    is_diverging: isDiverging(style),
    is_nearest: style.colormap === "labels",
  };
}

const lookOf = (state: ViewState): Look => ({
  ...state,
  overlay: state.overlay && overlayLook(state.overlay),
  slab_mm: slabOf(state),
  color_row: colorRow(state.colormap),
  isMirrored: false,
});

/** What the mirrored half shows: of one half, the other half. */
const mirroredLook = (look: Look): Look => ({ ...look, isMirrored: true, surface: mirroredSurface(look.surface) });

/** A state without those of its layers that are not here; in the place of a texture, the case's own intensities. */
export function withLayers(state: ViewState, { intensity }: ReadyCase, isHere: (name: string) => boolean): ViewState {
  if (layersOf(state).every(isHere)) return state;
  const half = (look: HalfLook): HalfLook => {
    const overlay = look.overlay && isHere(look.overlay.name) ? look.overlay : null;
    const found = { ...halfOf(look), overlay };
    return !look.layer || isHere(look.layer.id) ? found : { ...found, layer: null, window: intensity.window };
  };
  return { ...state, ...half(state), beside: state.beside && half(state.beside) };
}

/** The panes of a canvas of so many pixels. */
export function panesOf(state: ViewState, canvas: Vec2): Pane[] {
  const [across, down] = viewSize(state, canvas).map(Math.floor) as [number, number];
  const views = isHalved(state) ? [leftOf(state), state] : [state];
  return views.flatMap((view, at) =>
    partsOf(view).map(([part, clip]) => ({
      look: at > 0 && isMirrored(state) ? mirroredLook(lookOf(part)) : lookOf(part),
      left: at * (canvas[0] - across),
      top: at * (canvas[1] - down),
      size: [across, down],
      clip,
    })),
  );
}

/** The discs of the flat map, each with its surface. */
export const mapLooks = (state: ViewState, centres: Centres, shown: ReadyCase): readonly Look[] =>
  discsOf(centres, shown.midsagittal, state.map.has_inner).map((disc) => ({
    ...lookOf({ ...state, surface: surfaceOf(disc) }),
    onMap: { disc, view: state.map },
  }));

/** A slice: flat, lit everywhere alike. */
function sliceLookOf(
  state: ViewState,
  view: SliceView,
  { envelope_sphere }: ReadyCase,
  contours_mm: readonly number[],
): SliceLook {
  const overlay = edgesLayer(state);
  const drawn = overlay ? { ...bareOf(state), overlay } : state;
  return {
    look: { ...lookOf(drawn), ...sliceCamera(view), ...lookNumbers("plain"), depth_mm: 0 },
    center_in_patient: sliceCenter(view, envelope_sphere),
    contours_mm,
    has_edges: overlay !== null,
  };
}

/** The picture of a slice; each of its parts is drawn whole, and the columns of the others are put in. */
export async function slicePicture(
  painter: Pick<Painter, "slice">,
  state: ViewState,
  view: SliceView,
  shown: ReadyCase,
  contours_mm: readonly number[],
  size: Vec2,
): Promise<ImageData | null> {
  const draw = (part: ViewState): Promise<ImageData | null> =>
    painter.slice(sliceLookOf(part, view, shown, contours_mm), size);
  const picture = await draw(state);
  if (!picture) return null;
  const { width, height, data } = picture;
  for (const [part, [from, to]] of partsOf(state).slice(0, -1)) {
    const other = (await draw(part))?.data;
    if (!other) return null;
    // The pane flips what it is given.
    const [first, end] = isFlipped(view.plane, view.convention) ? [1 - to, 1 - from] : [from, to];
    const [left, right] = [Math.round(first * width), Math.round(end * width)];
    for (let row = 0; row < height; row += 1) {
      const at = 4 * row * width;
      data.set(other.subarray(at + 4 * left, at + 4 * right), at + 4 * left);
    }
  }
  return picture;
}
