// From a state to what the shaders are given: `render::gpu::uniforms`, with intensities in the place of stored values.

import { fromColumns, inColumns, product, scaleThenMove, transformDirection } from "../model/affine.ts";
import { project, towardsViewer, type Projection, type View } from "../model/camera.ts";
import type { MirrorPlane, Sphere, Window } from "../model/case.ts";
import { type Disc, MAP_MARGIN, type MapView, projectDisc } from "../model/flat-map.ts";
import { smoothShare } from "../model/isosurface.ts";
import { SOFT_PART } from "../model/maps.ts";
import { CUT_REACH } from "../model/points.ts";
import { reflected, reflection } from "../model/midsagittal.ts";
import { type LookNumbers, type ViewState, windowEnds } from "../model/state.ts";
import {
  type Affine,
  type Vec2,
  type Vec3,
  add,
  clamp,
  inverted,
  length,
  subtract,
  transform,
} from "../model/space.ts";
import type { PathsTable, TextureLayout } from "../model/wire.ts";

/** The fields of a uniform block by name. */
export type Fields = Readonly<Record<string, number | readonly number[]>>;

export interface TexelGrid {
  readonly size: Vec3;
  readonly patient_from_voxel: Affine;
  /** A value is scale · texel + offset: intensities, or depths in voxels. */
  readonly texelScale: number;
  readonly texelOffset: number;
}

/** What the shaders must know of a case's textures. */
export interface Maps {
  readonly volume: TexelGrid;
  readonly field: TexelGrid;
  /** Whether the volume is a layer, whose texels have a second part: whether they are defined. */
  readonly isLayer: boolean;
  /** The layer above the texture; null where there is none. */
  readonly overlay: TexelGrid | null;
  /**
   * The box around the border voxels' centres, in voxel coordinates of the field; null where the field is for light
   * alone.
   */
  readonly borderBox: readonly [Vec3, Vec3] | null;
  readonly sphere: Sphere;
  /** What a mirrored look is mirrored at. */
  readonly plane: MirrorPlane;
  /** The least edge of a native voxel, in mm. */
  readonly native_spacing_mm: number;
  /** The faces of the volume that cut the brain, their normals into the volume. */
  readonly cuts: readonly MirrorPlane[];
  /** The edge of a voxel of the working grid, in mm. */
  readonly spacing_mm: number;
}

/** What may lie elsewhere than its texture does. */
interface Moved {
  readonly moved?: Affine | undefined;
}

/** How a layer is coloured: see `render::layer`. */
export interface OverlayLook extends Moved {
  readonly name: string;
  /** The values of the first and the last colour. */
  readonly window: readonly [number, number];
  /** What is at most this is transparent; null: nothing is that is defined. */
  readonly threshold: number | null;
  readonly opacity: number;
  readonly color_row: number;
  /** Whether the threshold is one of magnitudes. */
  readonly is_diverging: boolean;
  /** Whether a position has the value of its nearest voxel. */
  readonly is_nearest: boolean;
}

export interface Look extends View, LookNumbers, Pick<ViewState, "surface" | "depth_mm" | "window"> {
  readonly color_row: number;
  /** The layer in the place of the volume. */
  readonly layer: ({ readonly id: string } & Moved) | null;
  /** The layer above the texture; both are drawn if their voxels are there. */
  readonly overlay: OverlayLook | null;
  /** Whether the head is mirrored at the plane between its hemispheres. */
  readonly isMirrored: boolean;
  /** A disc of the flat map, in the place of a view from one direction. */
  readonly onMap?: { readonly disc: Disc; readonly view: MapView };
}

/**
 * How far the isosurface may be outside of the box and the ball that are smaller by its depth, in voxels:
 * `render::gpu::uniforms`.
 */
const BOX_MARGIN = 2.01;
const BALL_MARGIN = 4;
/** How far the mesh may be outside of the ball around the envelope, in voxels. */
const CLIP_MARGIN = 4;
/** How many faces can cut a brain. */
const MOST_CUTS = 6;
/**
 * How far the samples of a pixel may be apart, in pixels, to be of one piece of the surface: `render::gpu::uniforms`.
 */
const PIECE_PIXELS = 8;
/** The most samples to either side of the isosurface that a slab is averaged over. */
const MAX_SLAB_SAMPLES = 64;

/** The affine from frame space (pixels right and down, mm towards the viewer) to what is seen there. */
function patientFromFrame(look: Look, { plane }: Maps, { positionOf }: Projection): Affine {
  const origin = positionOf([0, 0, 0]);
  const axis = (place: Vec3): Vec3 => subtract(positionOf(place), origin);
  const straight = fromColumns(axis([1, 0, 0]), axis([0, 1, 0]), axis([0, 0, 1]), origin);
  return look.isMirrored ? product(reflection(plane), straight) : straight;
}

function inverse(affine: Affine): Affine {
  const other = inverted(affine);
  if (!other) throw new RangeError("no inverse");
  return other;
}

/**
 * From the frame to the clip space of WebGL: x, y and z within ±1, y up, z -1 at the height `reach_mm` and 1 at minus
 * that.
 */
const clipFromFrame = ([width, height]: Vec2, reach_mm: number): Affine =>
  scaleThenMove([2 / width, -2 / height, -1 / reach_mm], [-1, 1, 0]);

/** How far from the frame's plane the sphere reaches. Mirrored, its centre need not stay where it was. */
function reachOf({ isMirrored }: Look, { sphere, plane }: Maps): number {
  const moved = isMirrored
    ? subtract(reflected(sphere.center_in_patient, plane), sphere.center_in_patient)
    : ([0, 0, 0] as const);
  return sphere.radius_mm + length(moved);
}

/** The window's ramp: black up to `black`, then by `factor` of 255 for each intensity. */
export function windowLine(window: Window): { readonly black: number; readonly factor: number } {
  const [black, white] = windowEnds(window);
  return { black, factor: 255 / Math.max(white - black, 1e-9) };
}

/**
 * Where a slab is sampled along the depth, in mm from the isosurface, at equal distances; nowhere when there is no
 * slab.
 */
export function slabOffsets(slab_mm: number, depth_mm: number, native_spacing_mm: number): number[] {
  if (slab_mm === 0) return [];
  const side = clamp(Math.ceil((2 * slab_mm) / native_spacing_mm), 1, MAX_SLAB_SAMPLES);
  const steps = Array.from({ length: 2 * side + 1 }, (_, index) => ((index - side) * slab_mm) / side);
  return steps.filter((offset_mm) => depth_mm + offset_mm >= 0);
}

/** The planes behind which the isosurface is unknown, in voxel coordinates of the field: `render::known`. */
function cutPlanes({ field, cuts, spacing_mm }: Maps, depth_mm: number): number[] {
  const rows = field.patient_from_voxel;
  const least_mm = depth_mm + CUT_REACH * spacing_mm;
  const planes = cuts.flatMap(({ normal, offset_mm }) =>
    [0, 0, 0, -offset_mm - least_mm].map((from, column) =>
      normal.reduce((sum, share, row) => sum + share * (rows[row]?.[column] ?? 0), from),
    ),
  );
  while (planes.length < 4 * MOST_CUTS) planes.push(0, 0, 0, 1e9);
  return planes;
}

/** The threshold of a map that has none. */
const NO_THRESHOLD = -2e9;

/** The fields of the block `Picture` that are of the overlay; without one the shaders sample nothing of it. */
function overlayFields(look: OverlayLook | null, { overlay, field }: Maps): Fields {
  if (!look || !overlay) return { overlay_opacity: 0 };
  const [low, high] = look.window;
  return {
    overlay_from_field: inColumns(product(inverse(overlay.patient_from_voxel), field.patient_from_voxel)),
    overlay_size: overlay.size,
    overlay_scale: overlay.texelScale,
    overlay_offset: overlay.texelOffset,
    overlay_low: low,
    overlay_factor: 255 / (high - low),
    overlay_threshold: look.threshold ?? NO_THRESHOLD,
    overlay_steepness: 1 / (SOFT_PART * (high - low)),
    overlay_opacity: look.opacity,
    overlay_color_row: look.color_row,
    overlay_is_diverging: look.is_diverging ? 1 : 0,
    overlay_is_nearest: look.is_nearest ? 1 : 0,
  };
}

/** The fields of the block `Picture` that are of a disc of the flat map. */
function mapFields({ onMap }: Look, { field }: Maps, size: Vec2): Fields {
  if (!onMap) return { map_units_per_pixel: 0 };
  const { disc, view } = onMap;
  const { center, pixels_per_unit } = projectDisc(disc, view, size);
  const [right, up, towards] = disc.axes;
  // The grid of the depths lies along the patient's axes: a voxel's length is a voxel's length in all directions.
  const middle = transform(inverse(field.patient_from_voxel), disc.center_in_patient);
  return {
    field_from_frame: inColumns(fromColumns(right, up, towards, middle)),
    map_centre: center,
    map_units_per_pixel: 1 / pixels_per_unit,
  };
}

/** The block `Picture` for a pane of `size` pixels. */
export function pictureFields(look: Look, maps: Maps, size: Vec2): Fields {
  const { field, volume, sphere, plane } = maps;
  const projection = project(look, sphere, size);
  const patient_from_frame = patientFromFrame(look, maps, projection);
  const field_from_patient = inverse(field.patient_from_voxel);
  const voxel_mm = voxelMm(field);
  const depth = look.depth_mm / voxel_mm;
  const reach_mm = reachOf(look, maps) + CLIP_MARGIN * voxel_mm;
  const towards = towardsViewer(look.orientation);
  const slab = slabOffsets(look.slab_mm, look.depth_mm, maps.native_spacing_mm);
  const { black, factor } = windowLine(look.window);
  const [low, high] = maps.borderBox ?? [[0, 0, 0], subtract(field.size, [1, 1, 1])];
  const inset = depth - BOX_MARGIN;
  return {
    field_from_frame: inColumns(
      product(field_from_patient, product(patient_from_frame, scaleThenMove([1, 1, voxel_mm], [0, 0, 0]))),
    ),
    volume_from_field: inColumns(product(inverse(volume.patient_from_voxel), field.patient_from_voxel)),
    field_from_patient: inColumns(field_from_patient),
    clip_from_patient: inColumns(product(clipFromFrame(size, reach_mm), inverse(patient_from_frame))),
    volume_size: volume.size,
    stored_scale: volume.texelScale,
    field_size: field.size,
    stored_offset: volume.texelOffset,
    towards_viewer: look.isMirrored ? transformDirection(reflection(plane), towards) : towards,
    depth_scale: field.texelScale,
    box_low: add(low, [inset, inset, inset]),
    depth,
    box_high: subtract(high, [inset, inset, inset]),
    voxel_mm,
    sphere_centre: transform(field_from_patient, sphere.center_in_patient),
    sphere_radius: sphere.radius_mm / voxel_mm - depth + BALL_MARGIN,
    size,
    ambient: look.ambient,
    color_row: look.color_row,
    window_black: black,
    window_factor: factor,
    window_offset: 0,
    slab_count: Math.max(slab.length, 1),
    slab_first: slab[0] ?? 0,
    slab_step: slab.length > 1 ? (slab[1] ?? 0) - (slab[0] ?? 0) : 0,
    clip_reach: reach_mm / voxel_mm,
    clip_piece: (PIECE_PIXELS * projection.mm_per_pixel) / (2 * reach_mm),
    // With light alone, the isosurface is unknown.
    smooth_share: maps.borderBox ? smoothShare(depth) : 0,
    cuts: cutPlanes(maps, look.depth_mm),
    volume_has_gaps: maps.isLayer ? 1 : 0,
    ...overlayFields(look.overlay, maps),
    ...mapFields(look, maps, size),
  };
}

/** The block `Contours` for a slice of `size` pixels. */
export function contoursFields(look: Look, { field, sphere }: Maps, size: Vec2, depths_mm: readonly number[]): Fields {
  const { mm_per_pixel } = project(look, sphere, size);
  return {
    levels: depths_mm.map((depth_mm) => depth_mm / mm_per_pixel),
    count: depths_mm.length,
    depth_px: (field.texelScale * voxelMm(field)) / mm_per_pixel,
    px_per_mm: 1 / mm_per_pixel,
    cuts_px: look.depth_mm / mm_per_pixel,
  };
}

/** The edge of a voxel of the depth field. */
const voxelMm = ({ patient_from_voxel }: TexelGrid): number =>
  Math.hypot(...[0, 1, 2].map((row) => patient_from_voxel[row]?.[0] ?? 0));

/**
 * Where on a pane of `size` pixels anything of the envelope may be, in whole pixels; `top` counts from the top edge.
 */
export function extentOf(
  look: Look,
  maps: Maps,
  size: Vec2,
): { readonly left: number; readonly top: number; readonly size: Vec2 } {
  if (look.onMap) return extentOfDisc(look.onMap, size);
  const { patient_from_voxel, size: voxels } = maps.field;
  const [low, high] = maps.borderBox ?? [[0, 0, 0], subtract(voxels, [1, 1, 1])];
  const frame_from_field = product(
    inverse(patientFromFrame(look, maps, project(look, maps.sphere, size))),
    patient_from_voxel,
  );
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) =>
    transform(
      frame_from_field,
      [0, 1, 2].map((axis) =>
        (corner >> axis) & 1 ? (high[axis] ?? 0) + CLIP_MARGIN : (low[axis] ?? 0) - CLIP_MARGIN,
      ) as unknown as Vec3,
    ),
  );
  const span = (axis: 0 | 1): readonly [number, number] => {
    const places = corners.map((corner) => clamp(corner[axis], 0, size[axis]));
    return [Math.floor(Math.min(...places)), Math.ceil(Math.max(...places))];
  };
  const [[left, right], [top, bottom]] = [span(0), span(1)];
  return { left, top, size: [right - left, bottom - top] };
}

/** The square around a disc of the flat map, within the pane. */
function extentOfDisc({ disc, view }: NonNullable<Look["onMap"]>, size: Vec2): ReturnType<typeof extentOf> {
  const { center, pixels_per_unit } = projectDisc(disc, view, size);
  const radius = MAP_MARGIN * pixels_per_unit + 1;
  const span = (axis: 0 | 1): readonly [number, number] => {
    const within = (place: number): number => clamp(place, 0, size[axis]);
    return [Math.floor(within(center[axis] - radius)), Math.ceil(within(center[axis] + radius))];
  };
  const [[left, right], [top, bottom]] = [span(0), span(1)];
  return { left, top, size: [right - left, bottom - top] };
}

export function pathsFields(table: PathsTable, depth_mm: number): Fields {
  const row = Math.max(0, Math.min(Math.floor(depth_mm / table.row_mm), table.row_count - 2));
  const first_piece = table.first_piece[row] ?? 0;
  return {
    origin_in_patient: table.origin_in_patient,
    step_mm: table.step_mm,
    depth_mm,
    row_mm: table.row_mm,
    row,
    vertex_count: table.rows.length / 4 / table.row_count,
    first_piece,
    piece_count: (table.first_piece[row + 1] ?? first_piece) - first_piece,
  };
}

/** Where a texture's texels are and what they mean, `unit` being the stored value of a texel of 1. */
export const texelGrid = (layout: TextureLayout, unit: number): TexelGrid => ({
  size: layout.size,
  patient_from_voxel: layout.patient_from_voxel,
  texelScale: layout.scale * unit,
  texelOffset: layout.offset,
});

/** A texture's texels where it was moved to. */
export const movedGrid = (grid: TexelGrid, moved: Affine | undefined): TexelGrid =>
  moved ? { ...grid, patient_from_voxel: product(moved, grid.patient_from_voxel) } : grid;

/** The same for depths, in voxels. */
export function depthGrid(layout: TextureLayout, unit: number, stepsPerVoxel: number): TexelGrid {
  return { ...texelGrid(layout, unit), texelScale: unit / stepsPerVoxel, texelOffset: 0 };
}
