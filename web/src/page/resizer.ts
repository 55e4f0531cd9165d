// The edge of the list, which can be dragged or moved with arrows.

import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { LIST_WIDTHS, boundWidth } from "../store/preferences.ts";

/** In CSS pixels. */
const STEP = 16;
const [LEAST, MOST] = LIST_WIDTHS;

/** `show` gets every width during a drag, `keep` the last one. */
export function resizer(first: number, show: (width: number) => void, keep: (width: number) => void): HTMLElement {
  let width = boundWidth(first);
  const element = h("div", {
    class: "resizer",
    role: "separator",
    tabindex: 0,
    "aria-orientation": "vertical",
    "aria-label": t("cases.width"),
    "aria-valuemin": LEAST,
    "aria-valuemax": MOST,
  });
  const set = (wanted: number): void => {
    width = boundWidth(wanted);
    element.setAttribute("aria-valuenow", String(width));
    show(width);
  };
  set(width);
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    event.preventDefault();
    element.focus();
  });
  element.addEventListener("pointermove", (event) => {
    if (element.hasPointerCapture(event.pointerId)) set(event.clientX);
  });
  element.addEventListener("lostpointercapture", () => keep(width));
  element.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (steps === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    set(width + steps * STEP);
    keep(width);
  });
  return element;
}
