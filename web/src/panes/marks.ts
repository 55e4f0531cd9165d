// What a reader has marked and measured, on a picture: lines, and words beside them. A point is a number on a line that ends
// beside it, with a ring while the pointer is on either. They are painted all at once: as elements, ten thousand points would
// cost several times the picture.

import { h } from "../base/dom.ts";
import {
  type Box,
  type Lettering,
  type Line,
  type Mark,
  covered,
  freeOf,
  hairOf,
  lettered,
  pieces,
  ringOf,
  thinned,
} from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** More parts of lines than this at once are drawn thin: wide ones would take ten times as long, longer than the picture. */
const MANY = 500;
const LINE = 1.8;
/** A line reaches so far from its places: its casing, and what is soft about it. */
const REACH = 4;
/** Dark below a line, so that it is seen on white. */
const CASING = { width: 3.6, opacity: 0.6 } as const;
/** Of many marks, the first one in a cell of this size has words, in CSS pixels: hundreds of words hide the picture and take as long as all of its lines. */
const CELL_OF_MANY: Vec2 = [96, 48];
const AWAY = { dash: [3, 3], opacity: 0.75 } as const;

/** The words of so many marks can be read without seeing them: those of thousands take as long as their lines. */
const MOST_TOLD = 100;

/** The canvas is about as large as what is painted, in steps of so many pixels of the device: to put a large one up takes longer than to paint it. */
const STEP = 64;

export class Marks {
  readonly element = h("canvas", { class: "finding-marks", hidden: true, "aria-hidden": "true" });
  // Graphics devices are slow at long lines.
  readonly #context = this.element.getContext("2d", { willReadFrequently: true });
  #font = "";
  #marks: readonly Mark[] = [];
  #size: Vec2 = [0, 0];
  #pixel_mm = 1;
  #letters: readonly Lettering[] = [];
  #hovered: Mark | null = null;

  show(marks: readonly Mark[], size: Vec2, mm_per_pixel: number): void {
    [this.#marks, this.#size, this.#pixel_mm] = [marks, size, mm_per_pixel];
    this.#hovered = null;
    this.#draw();
  }

  /** Shows the ring of the point at which the pointer is, or whose number it is on. */
  point(place: Vec2 | null): void {
    const free = freeOf(this.#pixel_mm, this.#size);
    const isOn = (mark: Mark): boolean =>
      place !== null &&
      mark.parts.some(([point, more]) => point && !more && Math.hypot(place[0] - point[0], place[1] - point[1]) < free);
    const isIn = ({ box: [left, top, right, bottom] }: Lettering): boolean =>
      place !== null && place[0] >= left && place[0] <= right && place[1] >= top && place[1] <= bottom;
    const hovered = this.#letters.find(isIn)?.mark ?? this.#marks.find(isOn) ?? null;
    if (hovered === this.#hovered) return;
    this.#hovered = hovered;
    this.#draw();
  }

  #draw(): void {
    const { element } = this;
    const marks = this.#marks;
    if (element.hidden && marks.length === 0) return;
    element.hidden = marks.length === 0;
    // What is painted cannot be read from a canvas: the first words, how many are dashed, and where the last one ends.
    Object.assign(element.dataset, {
      words: marks
        .slice(0, MOST_TOLD)
        .map(({ words }) => words)
        .join("\n"),
      away: marks.filter(({ isAway }) => isAway).length,
      end:
        marks
          .at(-1)
          ?.parts.at(-1)
          ?.at(-1)
          ?.map((along) => along.toFixed(1)) ?? "",
    });
    element.dataset.ring = this.#hovered?.words ?? "";
    this.#letters = [];
    if (element.hidden || !this.#context) return;
    this.#context.font = this.#font ||= fontOf(element);
    this.#letters = paint(this.#context, marks, {
      pane: this.#size,
      free: freeOf(this.#pixel_mm, this.#size),
      hovered: this.#hovered,
    });
  }
}

const fontOf = (element: Element): string => {
  const { fontWeight, fontSize, fontFamily } = getComputedStyle(element);
  return `${fontWeight} ${fontSize} ${fontFamily}`;
};

interface Pane {
  readonly pane: Vec2;
  /** The radius around a point that is free. */
  readonly free: number;
  readonly hovered: Mark | null;
}

/** Paints marks, and returns where their words are. */
function paint(
  context: CanvasRenderingContext2D,
  marks: readonly Mark[],
  { pane, free, hovered }: Pane,
): readonly Lettering[] {
  const { font } = context;
  const widthOf = (words: string): number => context.measureText(words).width;
  const isMany = marks.reduce((sum, { parts }) => sum + parts.reduce((all, { length }) => all + length, 0), 0) > MANY;
  const letters = lettered(marks, pane, widthOf, { free, cell: isMany ? CELL_OF_MANY : null });
  const hairs = new Map(letters.map(({ mark, hair }) => [mark, hair]));
  const linesOf = (mark: Mark): readonly Line[] =>
    mark.parts.flatMap((part) => {
      const [place, second] = part;
      if (!place || second) return [thinned(part)];
      return [hairs.get(mark) ?? hairOf(place, free), ...(mark === hovered ? [ringOf(place, free)] : [])];
    });
  const looks = new Map<string, { readonly mark: Mark; readonly lines: Line[] }>();
  for (const mark of marks) {
    const look = `${mark.colour} ${mark.isAway}`;
    const alike = looks.get(look) ?? { mark, lines: [] };
    alike.lines.push(...linesOf(mark));
    looks.set(look, alike);
  }
  const lines = [...looks.values()].flatMap((alike) => alike.lines);
  place(context, covered(lines, letters, { pane, reach: REACH, step: STEP / devicePixelRatio }));
  context.lineJoin = "bevel";
  for (const { mark, lines: alike } of looks.values()) {
    context.setLineDash(mark.isAway ? AWAY.dash : []);
    const opacity = mark.isAway ? AWAY.opacity : 1;
    for (const piece of pieces(alike)) {
      context.beginPath();
      for (const line of piece) trace(context, line);
      if (isMany) strokeThin(context, mark.colour, opacity);
      else {
        stroke(context, "#000", CASING.width, opacity * CASING.opacity);
        stroke(context, mark.colour, LINE, opacity);
      }
    }
  }
  context.setLineDash([]);
  context.font = font;
  context.lineWidth = 3;
  context.strokeStyle = "#000";
  for (const { mark, at } of letters) {
    context.globalAlpha = mark.isAway ? AWAY.opacity : 1;
    context.fillStyle = mark.colour;
    context.strokeText(mark.words, ...at);
    context.fillText(mark.words, ...at);
  }
  context.globalAlpha = 1;
  return letters;
}

/** Puts the canvas around a part of the pane, empty, with its origin in the corner of the pane. */
function place(context: CanvasRenderingContext2D, [left, top, right, bottom]: Box): void {
  const { canvas } = context;
  const [width, height] = [right - left, bottom - top];
  const [wide, high] = [Math.round(width * devicePixelRatio), Math.round(height * devicePixelRatio)];
  // What lies beside the pane is not seen, and a canvas without pixels cannot be read.
  canvas.hidden = wide === 0 || high === 0;
  // A canvas that gets a size is made again.
  if (canvas.width !== wide) canvas.width = wide;
  if (canvas.height !== high) canvas.height = high;
  Object.assign(canvas.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, wide, high);
  context.scale(devicePixelRatio, devicePixelRatio);
  context.translate(-left, -top);
}

function trace(context: CanvasRenderingContext2D, places: Line): void {
  const [[x, y] = [0, 0], ...rest] = places;
  context.moveTo(x, y);
  for (const [nextX, nextY] of rest) context.lineTo(nextX, nextY);
}

/** Lines of one pixel of the device, with a shadow of theirs instead of a casing. */
function strokeThin(context: CanvasRenderingContext2D, colour: string, opacity: number): void {
  const pixel = 1 / devicePixelRatio;
  context.translate(pixel, pixel);
  stroke(context, "#000", pixel, opacity * CASING.opacity);
  context.translate(-pixel, -pixel);
  stroke(context, colour, pixel, opacity);
}

function stroke(context: CanvasRenderingContext2D, colour: string, width: number, opacity: number): void {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.globalAlpha = opacity;
  context.stroke();
}
