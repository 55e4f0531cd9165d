// Draws what it has been given of a case, with the server's own shaders. It fetches nothing and knows nothing of the
// page.

import { colorTable } from "./colors.ts";
import { STEPS_PER_VOXEL } from "../model/field.ts";
import { EQUIPMENT } from "./equipment.ts";
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
  made,
  readTarget,
  writePositions,
  UniformBlock,
  UNITS,
  type DepthTarget,
  type Gl,
  type Target,
  type Vertices,
} from "./gl.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { CaseMaps, Drawn, FieldMaps, Pane, Quality, SliceLook } from "./scene.ts";
import { fitting, inLines, scaled } from "./sizes.ts";
import {
  contoursFields,
  depthGrid,
  extentOf,
  movedGrid,
  pathsFields,
  pictureFields,
  texelGrid,
  type Look,
  type Maps,
  type TexelGrid,
} from "./uniforms.ts";
import { MOST_SHOWN } from "../model/state.ts";
import type { SurfaceName } from "../model/surfaces.ts";
import type { Block, PathsTable } from "../model/wire.ts";

const UPLOAD_BYTES = 1 << 20;
interface Texture {
  readonly texture: WebGLTexture;
  readonly grid: TexelGrid;
}

interface VolumeTexture extends Texture {
  /** Whether it is all that was acquired. */
  readonly isWhole: boolean;
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

export class Painter {
  readonly #gl: Gl;
  readonly #encodings: Encodings;
  readonly #picture: UniformBlock;
  readonly #paths: UniformBlock;
  readonly #contours: UniformBlock;
  readonly #programs: Readonly<Record<"mesh" | "shrink" | "reduce" | "trace" | "slice", WebGLProgram>>;
  readonly #case: CaseMaps;
  #mesh: { readonly vertices: Vertices; readonly indexCount: number } | null = null;
  /** What the vertices' positions are of. */
  #positioned: { readonly depth_mm: number; readonly by: FieldTextures | "server" } | null = null;
  readonly #shrinkings = new Map<SurfaceName, Shrinking>();
  #volume: VolumeTexture | null = null;
  /** By name or id, the one that came last at the end. */
  readonly #layers = new Map<string, Texture>();
  readonly #fields = new Map<SurfaceName, FieldTextures>();
  #coarse: Target | null = null;
  #slice: Target | null = null;
  #map: Target | null = null;
  #depths: DepthTarget | null = null;

  /** Compiles the shaders and finds out what the device can do. */
  constructor(gl: Gl, shown: CaseMaps) {
    this.#gl = gl;
    this.#case = shown;
    this.#encodings = made(findEncodings(gl, EQUIPMENT.probe));
    this.#picture = new UniformBlock(gl, EQUIPMENT, "Picture");
    this.#paths = new UniformBlock(gl, EQUIPMENT, "Paths");
    this.#contours = new UniformBlock(gl, EQUIPMENT, "Contours");
    this.#programs = {
      mesh: createTranslated(gl, EQUIPMENT, "mesh.vert.glsl"),
      shrink: createCapturing(gl, EQUIPMENT, "shrink.vert.glsl"),
      reduce: createTranslated(gl, EQUIPMENT, "screen.vert.glsl", "reduce.frag.glsl"),
      trace: createTranslated(gl, EQUIPMENT, "screen.vert.glsl", "trace.frag.glsl"),
      slice: createTranslated(gl, EQUIPMENT, "screen.vert.glsl", "slice.frag.glsl"),
    };
    const table = colorTable(EQUIPMENT.colors);
    gl.activeTexture(gl.TEXTURE0 + UNITS.colors);
    createTable(gl, { internal: gl.RGBA8, layout: gl.RGBA, type: gl.UNSIGNED_BYTE }, [256, table.length / 1024], table);
    // Pictures without an overlay read nothing of it, but a texture must be there.
    gl.activeTexture(gl.TEXTURE0 + UNITS.overlay);
    createBlock(gl, gapped(gl, true, this.#encodings).format, [1, 1, 1]);
  }

  setTriangles(triangles: Uint32Array): void {
    const vertexCount = triangles.reduce((most, vertex) => Math.max(most, vertex + 1), 0);
    const indices = createIndices(this.#gl, triangles);
    this.#mesh = { vertices: createVertices(this.#gl, indices, vertexCount), indexCount: triangles.length };
    this.#positioned = null;
  }

  /** Takes the positions of one depth; `setTriangles` comes first. */
  setPositions(positions: Float32Array, depth_mm: number): void {
    writePositions(this.#gl, made(this.#mesh).vertices, positions);
    this.#positioned = { depth_mm, by: "server" };
  }

  /** Takes the table of all depths of a surface. */
  setPaths(table: PathsTable, surface: SurfaceName = "whole"): void {
    const gl = this.#gl;
    const rows = inLines(table.rows, 4);
    const pieces = inLines(table.pieces, 1);
    gl.activeTexture(gl.TEXTURE0 + UNITS.rows);
    const former = this.#shrinkings.get(surface);
    for (const old of former ? [former.rows, former.pieces] : []) gl.deleteTexture(old);
    this.#shrinkings.set(surface, {
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
    });
  }

  /** Takes intensities, some slices at a time; the ones before them are drawn with until all are there. */
  *setVolume(volume: Block, isWhole: boolean): Generator<void, void> {
    const encoding = volume.format === "u8" ? this.#encodings.bytes : this.#encodings.intensities;
    const texture = yield* this.#uploaded(encoding, volume.size, volume.voxels);
    if (this.#volume) this.#gl.deleteTexture(this.#volume.texture);
    this.#volume = { texture, grid: texelGrid(volume, encoding.unit), isWhole };
  }

  hasLayer(name: string): boolean {
    return this.#layers.has(name);
  }

  /** Takes the voxels of a layer, some slices at a time; of too many layers those that came first go. */
  *setLayer(name: string, layer: Block): Generator<void, void> {
    const encoding = gapped(this.#gl, layer.format === "u8", this.#encodings);
    const texture = yield* this.#uploaded(encoding, layer.size, layer.voxels);
    this.dropLayer(name);
    this.#layers.set(name, { texture, grid: texelGrid(layer, encoding.unit) });
    for (const old of [...this.#layers.keys()].slice(0, -MOST_SHOWN)) this.dropLayer(old);
  }

  /** Drops the voxels of a layer: they are no longer what the server has. */
  dropLayer(name: string): void {
    this.#gl.deleteTexture(this.#layers.get(name)?.texture ?? null);
    this.#layers.delete(name);
  }

  /** Takes the depths of a surface, or with `smoothed` null their gradients alone, some slices at a time. */
  *setField(maps: FieldMaps, surface: SurfaceName = "whole"): Generator<void, void> {
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
    const former = this.#fields.get(surface);
    for (const old of [former?.normals, ...(former?.depths ?? [])]) gl.deleteTexture(old ?? null);
    this.#fields.set(surface, {
      grid: depthGrid(field, depths.unit, STEPS_PER_VOXEL),
      borderBox: maps.borderBox,
      normals,
      depths: textures,
    });
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

  hasSurface(surface: SurfaceName): boolean {
    return this.#fields.get(surface)?.depths != null;
  }

  canDraw(way: Drawn, depth_mm: number, surfaces: readonly SurfaceName[]): boolean {
    const fields = surfaces.map((surface) => this.#fields.get(surface));
    if (!this.#volume || !fields.every((field) => field !== undefined)) return false;
    if (way === "exact") return fields.every(({ depths }) => depths !== null);
    const isPositioned = surfaces.every((surface) => surface === "whole") && this.#positioned?.depth_mm === depth_mm;
    return this.#mesh !== null && (isPositioned || surfaces.every((surface) => this.#shrinkings.has(surface)));
  }

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
      if (way === "mesh") this.#drawDepths(pane.look, scaled([width, height], depths));
      const [left, top] = [pane.left, pane.top].map((part) => Math.round(part * share)) as [number, number];
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.viewport(left, size[1] - top - height, width, height);
      // Software works out every pixel, lit or not.
      const extent = extentOf(pane.look, maps, [width, height]);
      gl.enable(gl.SCISSOR_TEST);
      const [first, end] = pane.clip.map((part) => Math.round(part * width)) as [number, number];
      const from = Math.max(extent.left, first);
      const across = Math.max(Math.min(extent.left + extent.size[0], end) - from, 0);
      gl.scissor(left + from, size[1] - top - extent.top - extent.size[1], across, extent.size[1]);
      this.#shade(way);
      gl.disable(gl.SCISSOR_TEST);
    }
    if (!target) return;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, ...size, 0, 0, ...full, gl.COLOR_BUFFER_BIT, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Draws the discs of a map into a picture of `size` pixels, beside the canvas. */
  map(discs: readonly Look[], size: Vec2): Promise<ImageData | null> {
    const gl = this.#gl;
    this.#map = fitting(this.#map, size) ?? createTarget(gl, size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#map.frame);
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const look of discs) {
      const { left, top, size: extent } = extentOf(look, this.#takeUp(look, size), size);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(left, size[1] - top - extent[1], ...extent);
      this.#shade("exact");
      gl.disable(gl.SCISSOR_TEST);
    }
    return readTarget(gl, this.#map);
  }

  get canSlice(): boolean {
    return this.#volume?.isWhole === true && this.#fields.get("whole")?.depths != null;
  }

  /** Draws a slice of `size` pixels, beside the canvas. */
  slice({ look, center_in_patient, contours_mm, has_edges }: SliceLook, size: Vec2): Promise<ImageData | null> {
    const gl = this.#gl;
    const { sphere } = this.#case;
    this.#slice = fitting(this.#slice, size) ?? createTarget(gl, size);
    const maps = this.#takeUp(look, size, { ...sphere, center_in_patient });
    const contours = contoursFields(look, maps, size, contours_mm);
    this.#contours.write({ ...contours, has_edges: has_edges && maps.overlay ? 1 : 0 });
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#slice.frame);
    gl.viewport(0, 0, ...size);
    this.#fill(this.#programs.slice);
    return readTarget(gl, this.#slice);
  }

  /** Hands over what all passes of a pane are given. */
  #takeUp(look: Look, size: Vec2, sphere = this.#case.sphere): Maps {
    const volume = made(this.#volume);
    const field = made(this.#fields.get(look.surface) ?? null);
    const layer = look.layer && this.#layers.get(look.layer.id);
    const overlay = look.overlay && this.#layers.get(look.overlay.name);
    const { grid, borderBox } = field;
    const texture = layer ?? volume;
    const maps: Maps = {
      ...this.#case,
      sphere,
      volume: layer ? movedGrid(layer.grid, look.layer?.moved) : volume.grid,
      isLayer: texture === layer,
      field: grid,
      overlay: overlay ? movedGrid(overlay.grid, look.overlay?.moved) : null,
      borderBox,
    };
    this.#picture.write(pictureFields(look, maps, size));
    this.#bind(UNITS.volume, texture.texture);
    this.#bind(UNITS.normals, field.normals);
    if (overlay) this.#bind(UNITS.overlay, overlay.texture);
    if (field.depths) {
      this.#bind(UNITS.field, field.depths[0]);
      this.#bind(UNITS.smoothed, field.depths[1]);
    }
    return maps;
  }

  /** Draws the mesh into a depth buffer of `size`. */
  #drawDepths(look: Look, size: Vec2): void {
    const gl = this.#gl;
    const mesh = made(this.#mesh);
    this.#shrink(mesh.vertices, look);
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
  #shrink(vertices: Vertices, { depth_mm, surface }: Look): void {
    const field = this.#fields.get(surface) ?? null;
    const shrinking = this.#shrinkings.get(surface) ?? null;
    if (this.#positioned?.depth_mm === depth_mm && (!shrinking || this.#positioned.by === field)) return;
    const { table, rows, pieces } = made(shrinking);
    this.#paths.write(pathsFields(table, depth_mm));
    this.#bind(UNITS.rows, rows, this.#gl.TEXTURE_2D);
    this.#bind(UNITS.pieces, pieces, this.#gl.TEXTURE_2D);
    computePositions(this.#gl, this.#programs.shrink, vertices);
    this.#positioned = { depth_mm, by: made(field) };
  }

  #shade(way: Drawn): void {
    this.#fill(way === "mesh" ? this.#programs.reduce : this.#programs.trace);
  }

  #fill(program: WebGLProgram): void {
    const gl = this.#gl;
    gl.useProgram(program);
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
