// What a reader has marked and measured, on a picture: a ring for a point, a line for all others, and words beside it. They are
// painted all at once: as elements, ten thousand points would cost several times the picture.

import { h } from "../base/dom.ts";
import { type Box, type Line, type Mark, covered, lettered, pieces, thinned } from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** More parts of lines than this at once are drawn thin: wide ones would take ten times as long, longer than the picture. */
const MANY = 500;
/** A ring takes as long as so many of them. */
const PARTS_OF_RING = 2;
/** The radius of a point, in CSS pixels: what is marked lies free in the middle. */
const RADIUS = 7;
const LINE = 1.8;
/** A mark reaches so far from its places: its ring, or its casing, and what is soft about them. */
const REACH = 10;
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

  show(marks: readonly Mark[], [width, height]: Vec2): void {
    const { element } = this;
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
    if (element.hidden || !this.#context) return;
    this.#font ||= fontOf(element);
    paint(this.#context, marks, [width, height], this.#font);
  }
}

const fontOf = (element: Element): string => {
  const { fontWeight, fontSize, fontFamily } = getComputedStyle(element);
  return `${fontWeight} ${fontSize} ${fontFamily}`;
};

function paint(context: CanvasRenderingContext2D, marks: readonly Mark[], pane: Vec2, font: string): void {
  const looks = new Map<string, Mark[]>();
  for (const mark of marks) {
    const look = `${mark.colour} ${mark.isAway}`;
    const alike = looks.get(look);
    if (alike) alike.push(mark);
    else looks.set(look, [mark]);
  }
  const lines = [...looks.values()].map((alike) => alike.flatMap(({ parts }) => parts.map(thinned)));
  const partsOf = ({ length }: Line): number => (length === 1 ? PARTS_OF_RING : length);
  const isMany = lines.flat().reduce((sum, line) => sum + partsOf(line), 0) > MANY;
  context.font = font;
  const widthOf = (words: string): number => context.measureText(words).width;
  const letters = lettered(marks, pane, widthOf, isMany ? CELL_OF_MANY : null);
  place(context, covered(marks, letters, { pane, reach: REACH, step: STEP / devicePixelRatio }));
  context.lineJoin = "bevel";
  [...looks.values()].forEach(([one], at) => {
    const { colour = "", isAway = false } = one ?? {};
    context.setLineDash(isAway ? AWAY.dash : []);
    const opacity = isAway ? AWAY.opacity : 1;
    for (const piece of pieces(lines[at] ?? [])) {
      context.beginPath();
      for (const line of piece) trace(context, line);
      if (isMany) strokeThin(context, colour, opacity);
      else {
        stroke(context, "#000", CASING.width, opacity * CASING.opacity);
        stroke(context, colour, LINE, opacity);
      }
    }
  });
  context.setLineDash([]);
  context.font = font;
  context.lineWidth = 3;
  context.strokeStyle = "#000";
  for (const { words, at, colour, isAway } of letters) {
    context.globalAlpha = isAway ? AWAY.opacity : 1;
    context.fillStyle = colour;
    context.strokeText(words, ...at);
    context.fillText(words, ...at);
  }
  context.globalAlpha = 1;
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
  if (rest.length === 0) {
    context.moveTo(x + RADIUS, y);
    context.arc(x, y, RADIUS, 0, 2 * Math.PI);
    return;
  }
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
