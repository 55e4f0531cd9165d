// Making elements. Text goes in as text alone, so that no name or error can become markup.

export type Child = Node | string | null;
type Listener = (event: never) => void;
export type Attributes = Readonly<Record<string, string | number | boolean | Listener | null>>;

function fill(element: Element, attributes: Attributes, children: readonly Child[]): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value as EventListener);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null) element.setAttribute(name, String(value));
  }
  element.append(...children.filter((child) => child !== null));
}

/**
 * An element; a function among the attributes listens to the event of its name. A button submits nothing unless it says
 * so.
 */
export function h<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  attributes: Attributes = {},
  ...children: readonly Child[]
): HTMLElementTagNameMap[Tag] {
  const element = document.createElement(tag);
  fill(element, tag === "button" ? { type: "button", ...attributes } : attributes, children);
  return element;
}

export function svg<Tag extends keyof SVGElementTagNameMap>(
  tag: Tag,
  attributes: Attributes = {},
  ...children: readonly Child[]
): SVGElementTagNameMap[Tag] {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  fill(element, attributes, children);
  return element;
}

/** Sets an element's text where it is another one, so that nothing is announced twice. */
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** Shows words, or nothing at all where there are none. */
export function tell(element: HTMLElement, words: string): void {
  setText(element, words);
  element.hidden = words === "";
}

/** Sets an input's value, unless the user is typing into it. */
export function setValue(input: HTMLInputElement | HTMLSelectElement, value: string | number): void {
  const typing = input instanceof HTMLInputElement && input.type === "number" && document.activeElement === input;
  if (!typing && input.value !== String(value)) input.value = String(value);
}

/** The page's icons: their shapes are in `icons.svg`, in boxes of 24 by 24, drawn as lines. */
export const ICONS = [
  "play",
  "pause",
  "minus",
  "plus",
  "left",
  "right",
  "up",
  "down",
  "undo",
  "redo",
  "full",
  "panel",
  "enlarge",
  "menu",
  "close",
  "trash",
  "edit",
  "settings",
  "help",
  "point",
  "move",
  "window",
  "ruler",
  "across",
  "hide",
  "blur",
  "flair",
  "more",
  "export",
  "series",
] as const;
export type Icon = (typeof ICONS)[number];

export const icon = (name: Icon): SVGSVGElement =>
  svg("svg", { class: "icon", "aria-hidden": "true", focusable: "false" }, svg("use", { href: `#icon-${name}` }));

/** A button with an icon alone; its label is read out, and shown when the pointer rests on it. */
export function iconButton(name: Icon, label: string, onClick: () => void): HTMLButtonElement {
  return h("button", { class: "icon-button", "aria-label": label, title: label, click: onClick }, icon(name));
}
