// Questions and help in front of the page.

import { type Holder, type Refusal, getPicture, isBehindProxy, isByProxy, takeHanded } from "../base/api.ts";
import { h, iconButton, quiet } from "../base/dom.ts";
import { number, t, wordsBetween } from "../base/i18n.ts";
import { decoded } from "../base/picture.ts";
import { problemWords } from "../base/problem-words.ts";
import { DRAG_DIRECTIONS, WHEEL_USES } from "../model/controls.ts";
import { BINDINGS } from "../model/keys.ts";
import type { OnScreen } from "./export.ts";
import type { Preferences } from "../store/preferences.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import { isHalved } from "../model/state.ts";

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
): HTMLButtonElement => h("button", { type: "submit", value, ...attributes }, words);

/** Whether something is to be deleted; anything but the button that says so is a no. */
export async function confirmDelete(title: string, text: string): Promise<boolean> {
  const { closed } = open(
    title,
    "confirm-delete",
    h("p", {}, text),
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

/** Which of some volumes are to be added as layers: their numbers, from 0. */
export async function offerLayers(titles: readonly string[]): Promise<readonly number[]> {
  const boxes = titles.map(() => h("input", { type: "checkbox", checked: true }));
  const { closed } = open(
    t("offer.title"),
    "offer",
    quiet(t("offer.text")),
    ...titles.map((title, at) => h("label", { class: "inline" }, boxes[at] ?? null, title)),
    h("div", { class: "row end" }, closing("add", t("offer.add"), { class: "primary" }), closing("", t("offer.skip"))),
  );
  const isWanted = (await closed) === "add";
  return titles.flatMap((_, at) => (isWanted && boxes[at]?.checked ? [at] : []));
}

/** Asks for a short text; empty if it is not to be changed. */
export async function askText(title: string, label: string, value: string): Promise<string> {
  const input = h("input", { type: "text", id: "text", maxlength: 64, autocomplete: "off", value });
  const { closed } = open(
    title,
    "ask-text",
    h("label", {}, label, input),
    // The first one is what Enter does.
    h(
      "div",
      { class: "row end" },
      closing("enter", t("rename.enter"), { class: "primary" }),
      closing("", t("delete.keep")),
    ),
  );
  return (await closed) === "enter" ? input.value.trim() : "";
}

/** Asks for the token that the server requires, or lets its user sign in; empty if none was typed, null if a proxy may know the user. */
export async function askToken(refusal: Refusal): Promise<string | null> {
  // The page that opens a case from a PACS hands on what was typed there, once.
  const handed = takeHanded().token;
  if (handed) return handed;
  if (await isBehindProxy()) return askForProxy(refusal);
  const input = h("input", { type: "password", autocomplete: "off", required: true, id: "token" });
  const text = refusal.hadToken ? t("token.refused") : t("token.text");
  const { closed } = open(
    t("token.title"),
    "ask-token",
    quiet(text),
    h("label", {}, t("token.label"), input),
    h("div", { class: "row end" }, closing("enter", t("token.enter"), { class: "primary" })),
  );
  await closed;
  return input.value.trim();
}

/** Lets somebody sign in at the proxy in front of the server, in a window of its own; this page stays as it is. */
async function askForProxy({ problem, hadToken }: Refusal): Promise<string | null> {
  const input = h("input", { type: "password", autocomplete: "off", id: "token" });
  const isRefused = hadToken || problem.kind === "proxy-refused";
  const { closed } = open(
    t("sign-in.title"),
    "ask-proxy",
    quiet(isRefused ? problemWords(problem) : t("sign-in.proxy")),
    // The first one is what Enter does.
    h(
      "div",
      { class: "row" },
      h("a", { href: "./", target: "_blank", rel: "noopener", id: "sign-in" }, t("sign-in.enter")),
      closing("again", t("sign-in.again"), { class: "primary", autofocus: true }),
    ),
    h(
      "details",
      {},
      h("summary", {}, t("sign-in.token")),
      h("label", {}, t("token.label"), input),
      h("div", { class: "row end" }, closing("enter", t("token.enter"))),
    ),
  );
  return (await closed) === "again" ? null : input.value.trim();
}

/** Says who is signed in and what they may do, and lets them sign out. */
export function holderDialog(name: string, holder: Holder): void {
  const { scopes, sign_out } = holder;
  // Loading the page again forgets a token.
  const leave = (): void => location.assign(sign_out ?? "./");
  open(
    t("who.title"),
    "holder",
    h("p", { id: "holder" }, t("who.as", { name })),
    quiet(scopes.length > 0 ? t("who.may", { scopes: scopes.join(", ") }) : t("problem.missing-scope")),
    h(
      "div",
      { class: "row end" },
      // Whom a proxy knows would be signed in again at once.
      isByProxy(holder) && sign_out === undefined
        ? null
        : h("button", { type: "button", id: "sign-out", click: leave }, t("who.out")),
      closing("close", t("close"), { class: "primary", autofocus: true }),
    ),
  );
}

/** What hands and keys do, and what can be chosen about them. */
export function helpDialog(preferences: Preferences, change: (change: Partial<Preferences>) => void): void {
  // Each line is "how|what it is for"; what has no such parts is the title of those after it.
  const sections: HTMLElement[] = [];
  const begin = (title: string): void => {
    sections.push(h("section", {}, h("h3", {}, title), h("dl", { class: "help-list" })));
  };
  const add = (how: string, what: string): void =>
    sections.at(-1)?.lastElementChild?.append(h("dt", {}, how), h("dd", {}, what));
  for (const words of wordsBetween("help.mouse", "help.keys")) {
    const [how = "", what] = words.split("|");
    if (what === undefined) begin(how);
    else add(how, what);
  }
  begin(t("help.keys"));
  for (const { help, keys } of BINDINGS)
    add(typeof keys === "string" ? t(`key.${keys}`) : keys.join(", "), t(`help.key-${help}`));
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
    h("div", { class: "help-columns" }, ...sections),
    quiet(t("help.mirror")),
    quiet(t("help.slices")),
    quiet(`${t("help.letters")} ${t("letters.legend")}`),
    quiet(t("help.zero")),
    h("h3", {}, t("help.choices")),
    h("label", { class: "inline" }, t("wheel.label"), wheel),
    h("label", { class: "inline" }, t("drag.label"), drag),
    h("label", { class: "inline" }, keys, t("shortcuts.label")),
    quiet(t("notice.long")),
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary" })),
  );
  dialog.querySelector("form")?.prepend(iconButton("close", t("close"), () => dialog.close()));
  // Not the first choice, which would scroll the help away where it does not fit.
  dialog.querySelector<HTMLElement>(".icon-button")?.focus();
}

/** The server's own picture of a state, and its address to copy. */
export function serverPictureDialog({ shown: { id }, state, surface }: OnScreen): void {
  const query = renderQuery(surface.surface.served(state), pictureSize(surface.size(), devicePixelRatio, 1024));
  query.set("annotate", "true");
  const path = `${id}/render?${query}`;
  const address = new URL(`v1/cases/${path}`, document.baseURI).href;
  const place = h("div", { class: "server-shot" }, quiet(t("server.waiting")));
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
    ...(isHalved(state) ? [quiet(t(state.beside ? "server.right" : "server.half"))] : []),
    h("div", { class: "line" }, field, h("button", { click: () => void copy() }, t("server.copy"))),
    said,
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary", autofocus: true })),
  );
  void fill(place, path, t("server.alt", { depth: number(state.depth_mm, 1) }));
}

/** Nine slices with the mask's outline, to judge it by. */
export function maskDialog(id: string): void {
  const place = h("div", { class: "server-shot" }, quiet(t("server.waiting")));
  open(
    t("quality.look"),
    "mask",
    place,
    h("div", { class: "row end" }, closing("close", t("close"), { class: "primary", autofocus: true })),
  );
  void fill(place, `${id}/quality`, t("quality.alt"));
}

/** Puts a picture of the server into its place, or says why there is none; whether it is there. */
export async function fill(place: HTMLElement, path: string, alt: string): Promise<boolean> {
  try {
    const image = await decoded(await getPicture(path));
    image.alt = alt;
    place.replaceChildren(image);
    return true;
  } catch (problem) {
    place.replaceChildren(h("p", { class: "bad" }, problemWords(problem)));
    return false;
  }
}
