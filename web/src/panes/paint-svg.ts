// Paints what is drawn as SVG onto a canvas, as it is seen: for pictures that are saved.

import { decoded } from "../base/picture.ts";

/** What the style sheet says of drawings: a copy has it as attributes. */
const STYLED =
  "display opacity fill stroke stroke-width stroke-dasharray paint-order font-family font-size font-weight text-anchor dominant-baseline";

/** A drawing as a picture, in CSS pixels. */
export interface SvgPicture {
  readonly image: CanvasImageSource;
  readonly width: number;
  readonly height: number;
}

/** What a drawing looks like on the screen. A canvas is painted in one go, so this is asked for before. */
export async function svgPicture(drawing: SVGSVGElement): Promise<SvgPicture> {
  const { width, height } = drawing.getBoundingClientRect();
  const copy = drawing.cloneNode(true) as SVGSVGElement;
  const copies = [copy, ...copy.querySelectorAll("*")];
  for (const [at, one] of [drawing, ...drawing.querySelectorAll("*")].entries()) {
    const style = getComputedStyle(one);
    for (const name of STYLED.split(" ")) copies[at]?.setAttribute(name, style.getPropertyValue(name));
  }
  copy.setAttribute("width", String(width));
  copy.setAttribute("height", String(height));
  const text = new XMLSerializer().serializeToString(copy);
  return { image: await decoded(new Blob([text], { type: "image/svg+xml" })), width, height };
}
