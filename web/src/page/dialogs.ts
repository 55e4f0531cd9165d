// Questions and help in front of the page.

import { getPicture } from "../base/api.ts";
import { h, iconButton } from "../base/dom.ts";
import { type Key, number, t } from "../base/i18n.ts";
import { decoded } from "../base/picture.ts";
import { problemWords } from "../base/problem-words.ts";
import { DRAG_DIRECTIONS, WHEEL_USES } from "../model/controls.ts";
import type { Preferences } from "./preferences.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import type { Vec2 } from "../model/space.ts";
import { type ViewState, isHalved } from "../model/state.ts";

/** A dialog that is gone when it closes; the promise is of the value of the button that closed it. */
export function open(
  title: string,
  name: string,
  ...body: (Node | string)[]
): { dialog: HTMLDialogElement; closed: Promise<string> } {
  const heading = h("h2", { id: `${name}-title` }, title);
  const dialog = h(
    "dialog",
    { class: `dialog ${name}`, "aria-labelledby": `${name}-title` },
    h("form", { method: "dialog" }, heading, ...body),
  );
  document.body.append(dialog);
  const closed = new Promise<string>((resolve) =>
    dialog.addEventListener(
      "close",
      () => {
        dialog.remove();
        resolve(dialog.returnValue);
      },
      { once: true },
    ),
  );
  dialog.showModal();
  return { dialog, closed };
}

export const closing = (
  value: string,
  words: string,
  attributes: Record<string, string | boolean> = {},
): HTMLButtonElement => h("button", { value, ...attributes }, words);

/** Whether a case is to be deleted; anything but the button that says so is a no. */
export async function confirmDelete(title: string): Promise<boolean> {
  const { closed } = open(
    t("delete.title"),
    "confirm-delete",
    h("p", {}, t("delete.text", { title })),
    h(
      "div",
      { class: "row end" },
      closing("keep", t("delete.keep"), { autofocus: true }),
      closing("delete", t("delete.do"), { class: "danger" }),
    ),
  );
  return (await closed) === "delete";
}

/** Whether a case that was there already is to have another label. */
export async function confirmRename(title: string, name: string): Promise<boolean> {
  const { closed } = open(
    t("rename.title"),
    "confirm-rename",
    h("p", {}, t("rename.text", { title, name })),
    h(
      "div",
      { class: "row end" },
      closing("keep", t("rename.keep", { title }), { autofocus: true }),
      closing("rename", t("rename.do", { name })),
    ),
  );
  return (await closed) === "rename";
}

/** The token that the server wants; empty where none was typed. */
export async function askToken(refused: boolean): Promise<string> {
  const input = h("input", { type: "password", autocomplete: "off", required: true, id: "token" });
  const { closed } = open(
    t("token.title"),
    "ask-token",
    h("p", { class: "quiet" }, t(refused ? "token.refused" : "token.text")),
    h("label", {}, t("token.label"), input),
    h("div", { class: "row end" }, closing("enter", t("token.enter"), { class: "primary" })),
  );
  await closed;
  return input.value.trim();
}

const HELP: readonly (readonly [Key, readonly Key[]])[] = [
  [
    "help.mouse",
    [
      "help.drag",
      "help.wheel",
      "help.shift-drag",
      "help.right-drag",
      "help.alt-wheel",
      "help.double-click",
      "help.slice-click",
      "help.slice-drags",
      "help.slice-double",
    ],
  ],
  ["help.touch", ["help.one-finger", "help.two-fingers", "help.double-tap"]],
  [
    "help.keys",
    [
      "help.key-depth",
      "help.key-pages",
      "help.key-turn",
      "help.key-views",
      "help.key-window",
      "help.key-maps",
      "help.key-zoom",
      "help.key-play",
      "help.key-mark",
      "help.key-outline",
      "help.key-undo",
      "help.key-rest",
    ],
  ],
];

/** What hands and keys do, and what can be chosen about them. */
export function helpDialog(preferences: Preferences, change: (change: Partial<Preferences>) => void): void {
  // Each line is "what it is for: how".
  const lines = (keys: readonly Key[]): HTMLElement =>
    h(
      "dl",
      { class: "help-list" },
      ...keys.flatMap((key) => {
        const [how = "", what = ""] = t(key).split("|");
        return [h("dt", {}, how), h("dd", {}, what)];
      }),
    );
  const wheel = h(
    "select",
    { id: "wheel", change: () => change({ wheel: WHEEL_USES.find((use) => use === wheel.value) ?? "zoom" }) },
    ...WHEEL_USES.map((use) => h("option", { value: use, selected: use === preferences.wheel }, t(`wheel.${use}`))),
  );
  const drag = h(
    "select",
    { id: "drag", change: () => change({ drag: DRAG_DIRECTIONS.find((way) => way === drag.value) ?? "up-darker" }) },
    ...DRAG_DIRECTIONS.map((way) => h("option", { value: way, selected: way === preferences.drag }, t(`drag.${way}`))),
  );
  const keys = h("input", {
    type: "checkbox",
    id: "shortcuts",
    checked: preferences.shortcuts,
    change: () => change({ shortcuts: keys.checked }),
  });
  const { dialog } = open(
    t("help.title"),
    "help",
    h("p", {}, t("help.intro")),
    h(
      "div",
      { class: "help-columns" },
      ...HELP.map(([title, itsKeys]) => h("section", {}, h("h3", {}, t(title)), lines(itsKeys))),
    ),
    h("p", { class: "quiet" }, t("help.mirror")),
    h("p", { class: "quiet" }, t("help.slices")),
    h("p", { class: "quiet" }, t("help.zero")),
    h("h3", {}, t("help.choices")),
    h("label", { class: "inline" }, t("wheel.label"), wheel),
    h("label", { class: "inline" }, t("drag.label"), drag),
    h("label", { class: "inline" }, keys, t("shortcuts.label")),
    h("p", { class: "quiet" }, t("notice.long")),
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary" })),
  );
  dialog.querySelector("form")?.prepend(iconButton("close", t("close"), () => dialog.close()));
  // Not the first choice, which would scroll the help away where it does not fit.
  dialog.querySelector<HTMLElement>(".icon-button")?.focus();
}

/** The server's own picture of a state, and its address to copy. */
export function serverPictureDialog(id: string, state: ViewState, size: Vec2): void {
  const query = renderQuery(state, pictureSize(size, devicePixelRatio, 1024));
  query.set("annotate", "true");
  const path = `${id}/render?${query}`;
  const address = new URL(`v1/cases/${path}`, document.baseURI).href;
  const place = h("div", { class: "server-shot" }, h("p", { class: "quiet" }, t("server.waiting")));
  const field = h("input", {
    type: "text",
    readonly: true,
    value: address,
    id: "server-address",
    "aria-label": t("server.address"),
  });
  const said = h("span", { class: "quiet", role: "status" });
  const copy = async (): Promise<void> => {
    try {
      await navigator.clipboard.writeText(address);
      said.textContent = t("export.copied");
    } catch {
      field.select();
    }
  };
  open(
    t("server.title", { depth: number(state.depth_mm, 1) }),
    "server-picture",
    place,
    ...(isHalved(state) ? [h("p", { class: "quiet" }, t("server.half"))] : []),
    h("div", { class: "line" }, field, h("button", { type: "button", click: () => void copy() }, t("server.copy"))),
    said,
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary", autofocus: true })),
  );
  void fill(place, path, t("server.alt", { depth: number(state.depth_mm, 1) }));
}

/** Nine slices with the mask's outline, to judge it by. */
export function maskDialog(id: string): void {
  const place = h("div", { class: "server-shot" }, h("p", { class: "quiet" }, t("server.waiting")));
  open(
    t("quality.look"),
    "mask",
    place,
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary", autofocus: true })),
  );
  void fill(place, `${id}/quality`, t("quality.alt"));
}

/** Puts a picture of the server into its place, or says why there is none. */
async function fill(place: HTMLElement, path: string, alt: string): Promise<void> {
  try {
    const image = await decoded(await getPicture(path));
    image.alt = alt;
    place.replaceChildren(image);
  } catch (problem) {
    place.replaceChildren(h("p", { class: "bad" }, problemWords(problem)));
  }
}
