// The panes as one picture: what they show, then what stands on it.

import { type SvgPicture, svgPicture } from "./paint-svg.ts";

export interface Placed {
  readonly element: Element;
  readonly picture: CanvasImageSource;
  readonly isFlipped: boolean;
}

interface Box {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

/** Where an element lies within `frame`, in CSS pixels. */
function within(frame: Element, element: Element): Box {
  const [outer, box] = [frame.getBoundingClientRect(), element.getBoundingClientRect()];
  return { x: box.left - outer.left, y: box.top - outer.top, width: box.width, height: box.height };
}

/** Paints a canvas, one of whose units is a CSS pixel: all of it at once. */
export type Paint = (context: CanvasRenderingContext2D) => void;

/** How the panes are painted as they stand. A browser may forget what was painted on a canvas some time before. */
export async function panesPainter(panes: HTMLElement, pictures: readonly Placed[]): Promise<Paint> {
  const isShown = shownIn(panes);
  const shown = [
    ...panes.querySelectorAll<SVGSVGElement | HTMLCanvasElement>(
      "svg:is(.mask-outline, .map-lines, .trace, .cursor, .cube), canvas.finding-marks",
    ),
  ].filter(isShown);
  const drawings = await Promise.all(
    shown.map(async (drawing) => ({ ...within(panes, drawing), picture: await drawingOf(drawing) })),
  );
  return (context) => {
    context.fillStyle = "#000";
    context.fillRect(0, 0, panes.clientWidth, panes.clientHeight);
    paintPictures(context, panes, pictures);
    for (const { x, y, picture } of drawings) context.drawImage(picture.image, x, y, picture.width, picture.height);
    paintWriting(context, panes);
  };
}

/** What is drawn over a picture; a canvas is its own, before it is painted again. */
async function drawingOf(drawing: SVGSVGElement | HTMLCanvasElement): Promise<SvgPicture> {
  if (!(drawing instanceof HTMLCanvasElement)) return svgPicture(drawing);
  const { width, height } = drawing.getBoundingClientRect();
  return { image: await createImageBitmap(drawing), width, height };
}

function paintPictures(context: CanvasRenderingContext2D, panes: HTMLElement, pictures: readonly Placed[]): void {
  const isShown = shownIn(panes);
  const draw = (picture: CanvasImageSource, element: Element, isFlipped: boolean): void => {
    const { x, y, width, height } = within(panes, element);
    context.save();
    context.translate(isFlipped ? x + width : x, y);
    context.scale(isFlipped ? -1 : 1, 1);
    context.drawImage(picture, 0, 0, width, height);
    context.restore();
  };
  for (const { element, picture, isFlipped } of pictures) if (isShown(element)) draw(picture, element, isFlipped);
  for (const ramp of panes.querySelectorAll<HTMLCanvasElement>("canvas.ramp"))
    if (isShown(ramp)) draw(ramp, ramp, false);
}

/** Whether an element is to be seen: not under a slice that is as large as all panes. */
function shownIn(panes: HTMLElement): (element: Element) => boolean {
  const large = panes.querySelector(".pane.large");
  return (element) =>
    element.checkVisibility({ visibilityProperty: true }) && (!large?.checkVisibility() || large.contains(element));
}

function paintWriting(context: CanvasRenderingContext2D, panes: HTMLElement): void {
  const isShown = shownIn(panes);
  context.textBaseline = "middle";
  for (const element of panes.querySelectorAll<HTMLElement>(
    ".overlay span:not(.hovered), .colour-bar span, .pane-line span",
  )) {
    if (!isShown(element)) continue;
    const { x, y, width, height } = within(panes, element);
    const style = getComputedStyle(element);
    context.fillStyle = style.backgroundColor;
    context.fillRect(x, y, width, height);
    context.strokeStyle = style.borderTopColor;
    context.lineWidth = parseFloat(style.borderTopWidth);
    if (context.lineWidth > 0 && style.borderTopStyle !== "none") context.strokeRect(x, y, width, height);
    context.fillStyle = style.color;
    context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    const frame = panes.getBoundingClientRect();
    for (const { text, box } of linesOf(element))
      context.fillText(text, box.left - frame.left, box.top - frame.top + box.height / 2);
  }
}

/** The lines into which an element's text is broken on the screen. */
function linesOf(element: Element): readonly { readonly text: string; readonly box: DOMRect }[] {
  const lines: { text: string; box: DOMRect }[] = [];
  const node = element.firstChild;
  if (!(node instanceof Text)) return lines;
  const range = document.createRange();
  for (let at = 0; at < node.length; at += 1) {
    range.setStart(node, at);
    range.setEnd(node, at + 1);
    const box = range.getBoundingClientRect();
    const last = lines.at(-1);
    const letter = node.data[at] ?? "";
    if (letter === "\n" || box.width === 0) continue;
    if (last && Math.abs(last.box.top - box.top) < box.height / 2) last.text += letter;
    else lines.push({ text: letter, box });
  }
  return lines;
}
