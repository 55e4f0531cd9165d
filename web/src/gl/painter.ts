// Draws what it has been given of a case, with the server's own shaders. It fetches nothing and knows nothing of the
// page.

import { colorTable } from "./colors.ts";
import { STEPS_PER_VOXEL } from "../model/field.ts";
import { findEncodings, gapped, type Encoding, type Encodings } from "./formats.ts";
import {
  computePositions,
  createBlock,
  createCapturing,
  createDepthTarget,
  createIndices,
  createTable,
  createTarget,
  createTranslated,
  createVertices,
  fillSlices,
  writePositions,
  GlError,
  UniformBlock,
  UNITS,
  type DepthTarget,
  type Gl,
  type Equipment,
  type Target,
  type Vertices,
} from "./gl.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import {
  depthGrid,
  extentOf,
  pathsFields,
  pictureFields,
  texelGrid,
  type Look,
  type Maps,
  type TexelGrid,
} from "./uniforms.ts";
import type { Block, PathsTable } from "../model/wire.ts";
import { voxelCount } from "../model/wire.ts";

/** Bytes that are handed to the device at once. */
const UPLOAD_BYTES = 1 << 20;
/** Texels in a line of a table. */
const TABLE_WIDTH = 1024;
/** The fields of the blocks that are whole numbers. */
const WHOLES: ReadonlySet<string> = new Set([
  "color_row",
  "overlay_color_row",
  "overlay_is_diverging",
  "volume_has_gaps",
  "slab_count",
  "row",
  "vertex_count",
  "first_piece",
  "piece_count",
]);

/** What is made of the depth field for the shaders. */
export interface FieldMaps {
  readonly field: Block<Int16Array<ArrayBuffer>>;
  /** On the field's grid; null where only the light is drawn with it. */
  readonly smoothed: Int16Array<ArrayBuffer> | null;
  readonly gradients: Int8Array<ArrayBuffer>;
  readonly borderBox: readonly [Vec3, Vec3] | null;
}

/** A part of the picture: what it shows, and where it is, in pixels from the top left corner. */
export interface Pane {
  readonly look: Look;
  readonly left: number;
  readonly size: Vec2;
}

export type Drawn = "mesh" | "exact";

/** How much a picture may cost. */
export interface Quality {
  /** Below 1, it is drawn so much smaller and then enlarged. */
  readonly share: number;
  /** Depths of the mesh along a pixel's side: with 2 its edges are soft. */
  readonly depths: 1 | 2;
}

export const FULL_QUALITY: Quality = Object.freeze({ share: 1, depths: 2 });

interface Texture {
  readonly texture: WebGLTexture;
  readonly grid: TexelGrid;
}

interface FieldTextures {
  readonly grid: TexelGrid;
  readonly borderBox: FieldMaps["borderBox"];
  readonly normals: WebGLTexture;
  /** Depths and smoothed depths; null where only the light is drawn with it. */
  readonly depths: readonly [WebGLTexture, WebGLTexture] | null;
}

interface Shrinking {
  readonly table: PathsTable;
  readonly rows: WebGLTexture;
  readonly pieces: WebGLTexture;
}

/** What of the maps is the case's own. */
export type CaseMaps = Pick<Maps, "sphere" | "plane" | "native_spacing_mm" | "cuts" | "spacing_mm">;

export class Painter {
  readonly #gl: Gl;
  readonly #encodings: Encodings;
  readonly #picture: UniformBlock;
  readonly #paths: UniformBlock;
  readonly #programs: Readonly<Record<"mesh" | "shrink" | "reduce" | "trace", WebGLProgram>>;
  readonly #case: CaseMaps;
  #mesh: { readonly vertices: Vertices; readonly indexCount: number } | null = null;
  /** What the vertices' positions are of. */
  #positioned: { readonly depth_mm: number; readonly by: FieldTextures | "server" } | null = null;
  #shrinking: Shrinking | null = null;
  #volume: Texture | null = null;
  #overlay: (Texture & { readonly name: string }) | null = null;
  #field: FieldTextures | null = null;
  #coarse: Target | null = null;
  #depths: DepthTarget | null = null;

  /** Compiles the shaders and finds out what the device can do. */
  constructor(gl: Gl, { shaders: texts, colors }: Equipment, shown: CaseMaps) {
    this.#gl = gl;
    this.#case = shown;
    const encodings = findEncodings(gl);
    if (!encodings) throw new GlError("The graphics device filters no texture of 16 bits.");
    this.#encodings = encodings;
    this.#picture = new UniformBlock(gl, "Picture");
    this.#paths = new UniformBlock(gl, "Paths");
    this.#programs = {
      mesh: createTranslated(gl, texts, "mesh.vert.glsl"),
      shrink: createCapturing(gl, texts, "shrink.vert.glsl"),
      reduce: createTranslated(gl, texts, "screen.vert.glsl", "reduce.frag.glsl"),
      trace: createTranslated(gl, texts, "screen.vert.glsl", "trace.frag.glsl"),
    };
    const table = colorTable(colors);
    gl.activeTexture(gl.TEXTURE0 + UNITS.colors);
    createTable(gl, { internal: gl.RGBA8, layout: gl.RGBA, type: gl.UNSIGNED_BYTE }, [256, table.length / 1024], table);
    // Pictures without an overlay read nothing of it, but a texture must be there.
    gl.activeTexture(gl.TEXTURE0 + UNITS.overlay);
    createBlock(gl, gapped(gl).format, [1, 1, 1]);
  }

  /** The names of the texture formats, for the curious. */
  get formats(): string {
    const name = ({ format }: Encoding): string => `0x${format.internal.toString(16)}`;
    return `${name(this.#encodings.intensities)} ${name(this.#encodings.depths)}`;
  }

  /** Takes a mesh's triangles. */
  setTriangles(triangles: Uint32Array): void {
    const vertexCount = triangles.reduce((most, vertex) => Math.max(most, vertex + 1), 0);
    const indices = createIndices(this.#gl, triangles);
    this.#mesh = { vertices: createVertices(this.#gl, indices, vertexCount), indexCount: triangles.length };
    this.#positioned = null;
  }

  /** Takes the positions of one depth; `setTriangles` comes first. */
  setPositions(positions: Float32Array, depth_mm: number): void {
    if (!this.#mesh) throw new GlError("Positions came before their triangles.");
    writePositions(this.#gl, this.#mesh.vertices, positions);
    this.#positioned = { depth_mm, by: "server" };
  }

  /** Takes the table of all depths. */
  setPaths(table: PathsTable): void {
    const gl = this.#gl;
    const rows = inLines(table.rows, 4);
    const pieces = inLines(table.pieces, 1);
    gl.activeTexture(gl.TEXTURE0 + UNITS.rows);
    this.#shrinking = {
      table,
      rows: createTable(
        gl,
        { internal: gl.RGBA16UI, layout: gl.RGBA_INTEGER, type: gl.UNSIGNED_SHORT },
        rows.size,
        rows.texels,
      ),
      pieces: createTable(
        gl,
        { internal: gl.R32UI, layout: gl.RED_INTEGER, type: gl.UNSIGNED_INT },
        pieces.size,
        pieces.texels,
      ),
    };
  }

  /** Takes intensities, some slices at a time; the ones before them are drawn with until all are there. */
  *setVolume(volume: Block): Generator<void, void> {
    const encoding = volume.format === "u8" ? this.#encodings.bytes : this.#encodings.intensities;
    const texture = yield* this.#uploaded(encoding, volume.size, volume.voxels);
    if (this.#volume) this.#gl.deleteTexture(this.#volume.texture);
    this.#volume = { texture, grid: texelGrid(volume, encoding.unit) };
  }

  /** The name of the map that can lie over the picture; null while there is none. */
  get overlay(): string | null {
    return this.#overlay?.name ?? null;
  }

  /** Takes a map's voxels in the place of those of the one before, some slices at a time. */
  *setOverlay(name: string, layer: Block): Generator<void, void> {
    const encoding = gapped(this.#gl);
    const texture = yield* this.#uploaded(encoding, layer.size, layer.voxels);
    if (this.#overlay) this.#gl.deleteTexture(this.#overlay.texture);
    this.#overlay = { name, texture, grid: texelGrid(layer, encoding.unit) };
  }

  /** Takes depths, or with `smoothed` null their gradients alone, some slices at a time. */
  *setField(maps: FieldMaps): Generator<void, void> {
    const gl = this.#gl;
    const { field, smoothed } = maps;
    const format = { internal: gl.RGBA8_SNORM, layout: gl.RGBA, type: gl.BYTE };
    const bytes: Encoding = { format, unit: 127, encode: (voxels) => voxels };
    const depths = this.#encodings.depths;
    const normals = yield* this.#uploaded(bytes, field.size, maps.gradients);
    const textures = smoothed
      ? ([
          yield* this.#uploaded(depths, field.size, field.voxels),
          yield* this.#uploaded(depths, field.size, smoothed),
        ] as const)
      : null;
    for (const old of [this.#field?.normals, ...(this.#field?.depths ?? [])]) gl.deleteTexture(old ?? null);
    this.#field = {
      grid: depthGrid(field, depths.unit, STEPS_PER_VOXEL),
      borderBox: maps.borderBox,
      normals,
      depths: textures,
    };
  }

  *#uploaded(
    encoding: Encoding,
    size: Vec3,
    voxels: Parameters<Encoding["encode"]>[0] | Int8Array<ArrayBuffer>,
  ): Generator<void, WebGLTexture> {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + UNITS.volume);
    const texture = createBlock(gl, encoding.format, size);
    const slice = voxels.length / size[2];
    const together = Math.max(1, Math.floor(UPLOAD_BYTES / (slice * voxels.BYTES_PER_ELEMENT)));
    for (let first = 0; first < size[2]; first += together) {
      const count = Math.min(together, size[2] - first);
      const part = voxels.subarray(first * slice, (first + count) * slice);
      const texels = part instanceof Int8Array ? part : encoding.encode(part);
      gl.activeTexture(gl.TEXTURE0 + UNITS.volume);
      fillSlices(gl, texture, encoding.format, size, { first, count, texels });
      yield;
    }
    return texture;
  }

  /** Whether there is all that a picture wants. */
  canDraw(way: Drawn, depth_mm: number): boolean {
    if (!this.#volume || !this.#field) return false;
    if (way === "exact") return this.#field.depths !== null;
    return this.#mesh !== null && (this.#shrinking !== null || this.#positioned?.depth_mm === depth_mm);
  }

  /** Draws panes side by side into the canvas. */
  draw(panes: readonly Pane[], way: Drawn, { share, depths }: Quality): void {
    const gl = this.#gl;
    const full: Vec2 = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const size = scaled(full, share);
    const target = share < 1 ? this.#coarseTarget(size) : null;
    const frame = target?.frame ?? null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const pane of panes) {
      const [width, height] = scaled(pane.size, share);
      const maps = this.#takeUp(pane.look, [width, height]);
      if (way === "mesh") this.#drawDepths(pane.look.depth_mm, scaled([width, height], depths));
      const left = Math.round(pane.left * share);
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.viewport(left, size[1] - height, width, height);
      // Software works out every pixel, lit or not.
      const extent = extentOf(pane.look, maps, [width, height]);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(left + extent.left, size[1] - extent.top - extent.size[1], ...extent.size);
      this.#shade(way);
      gl.disable(gl.SCISSOR_TEST);
    }
    if (!target) return;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, ...size, 0, 0, ...full, gl.COLOR_BUFFER_BIT, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Hands over what all passes of a pane are given. */
  #takeUp(look: Look, size: Vec2): Maps {
    const { volume, field } = { volume: this.#volume, field: this.#field };
    if (!volume || !field) throw new GlError("A picture was asked for before there was anything to draw.");
    const overlay = this.#overlay?.grid ?? null;
    const { grid, borderBox } = field;
    const maps: Maps = { ...this.#case, volume: volume.grid, field: grid, overlay, borderBox };
    this.#picture.write(pictureFields(look, maps, size), WHOLES);
    this.#bind(UNITS.volume, volume.texture);
    this.#bind(UNITS.normals, field.normals);
    if (this.#overlay) this.#bind(UNITS.overlay, this.#overlay.texture);
    if (field.depths) {
      this.#bind(UNITS.field, field.depths[0]);
      this.#bind(UNITS.smoothed, field.depths[1]);
    }
    return maps;
  }

  /** Draws the mesh into a depth buffer of `size`. */
  #drawDepths(depth_mm: number, size: Vec2): void {
    const gl = this.#gl;
    const mesh = this.#mesh;
    if (!mesh) throw new GlError("The mesh is not there yet.");
    this.#shrink(mesh.vertices, depth_mm);
    gl.activeTexture(gl.TEXTURE0 + UNITS.depths);
    this.#depths = fitting(this.#depths, size) ?? createDepthTarget(gl, size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#depths.frame);
    gl.viewport(0, 0, ...size);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.#programs.mesh);
    gl.bindVertexArray(mesh.vertices.array);
    gl.drawElements(gl.TRIANGLES, mesh.indexCount, gl.UNSIGNED_INT, 0);
    gl.disable(gl.DEPTH_TEST);
    this.#bind(UNITS.depths, this.#depths.texture, gl.TEXTURE_2D);
  }

  /** Brings the vertices to a depth, unless they are there. */
  #shrink(vertices: Vertices, depth_mm: number): void {
    const field = this.#field;
    if (this.#positioned?.depth_mm === depth_mm && (!this.#shrinking || this.#positioned.by === field)) return;
    if (!this.#shrinking || !field) throw new GlError("The mesh of another depth is there.");
    const { table, rows, pieces } = this.#shrinking;
    this.#paths.write(pathsFields(table, depth_mm), WHOLES);
    this.#bind(UNITS.rows, rows, this.#gl.TEXTURE_2D);
    this.#bind(UNITS.pieces, pieces, this.#gl.TEXTURE_2D);
    computePositions(this.#gl, this.#programs.shrink, vertices);
    this.#positioned = { depth_mm, by: field };
  }

  /** Shades each pixel once. */
  #shade(way: Drawn): void {
    const gl = this.#gl;
    gl.useProgram(way === "mesh" ? this.#programs.reduce : this.#programs.trace);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #bind(unit: number, texture: WebGLTexture, target: GLenum = this.#gl.TEXTURE_3D): void {
    this.#gl.activeTexture(this.#gl.TEXTURE0 + unit);
    this.#gl.bindTexture(target, texture);
  }

  /** Where a picture is drawn that is enlarged for the canvas. */
  #coarseTarget(size: Vec2): Target {
    return (this.#coarse = fitting(this.#coarse, size) ?? createTarget(this.#gl, size));
  }
}

/** A size in other pixels; at least one. */
const scaled = ([width, height]: Vec2, by: number): Vec2 => [
  Math.max(1, Math.round(width * by)),
  Math.max(1, Math.round(height * by)),
];

/** The target, if it has this size; one of another size is given back. */
function fitting<T extends Target>(target: T | null, size: Vec2): T | null {
  if (target?.size.every((side, axis) => side === size[axis])) return target;
  target?.dispose();
  return null;
}

/** Numbers as texels of `parts` numbers each, in lines of a table; what is missing of the last line is 0. */
function inLines<T extends Uint16Array<ArrayBuffer> | Uint32Array<ArrayBuffer>>(
  numbers: T,
  parts: number,
): { readonly texels: T; readonly size: Vec2 } {
  const perLine = TABLE_WIDTH * parts;
  const lines = Math.max(1, Math.ceil(numbers.length / perLine));
  const texels = new (numbers.constructor as new (length: number) => T)(lines * perLine);
  texels.set(numbers);
  return { texels, size: [TABLE_WIDTH, lines] };
}

/** Bytes on the device that a case's textures take, at most. */
export const textureBytes = (field_size: Vec3, volume_size: Vec3): number =>
  8 * voxelCount(field_size) + 3 * voxelCount(volume_size);

/** Whether blocks of these sizes fit a device's textures. */
export function fits(gl: Gl, sizes: readonly Vec3[]): boolean {
  const most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
  return sizes.every((size) => size.every((side) => side <= most));
}
