// The section of the panel for the added layers: what they are and how they are placed, which of them are shown, and
// how another one is added.

import { changeLayer, deleteLayer } from "../base/api.ts";
import { failureWords } from "../base/case-words.ts";
import { type Attributes, h, type Icon, iconButton, quiet, setText, status } from "../base/dom.ts";
import { spoken, t } from "../base/i18n.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import {
  CONTRASTS,
  type Contrast,
  LAYER_KINDS,
  type Layer,
  type LayerList,
  TRANSFORMS,
  greyOf,
  isAdded,
  isReady,
} from "../model/layers.ts";
import type { ViewState } from "../model/state.ts";
import type { CaseLayers } from "./case-layers.ts";
import { askText, confirmDelete } from "./dialogs.ts";
import { button, choice, fileButton, fileInput, line } from "./fields.ts";
import { sendLayer, wishOf } from "./layer-form.ts";
import { Transfer } from "./transfer.ts";
import { freeName, sortLayers } from "./upload-files.ts";

interface LayersListener {
  grey(id: string | null): void;
  colours(id: string): void;
  announce(words: string): void;
}

export class LayersSection {
  readonly element: HTMLElement;
  /** Where the controls of an overlay stand. */
  readonly slot = h("div", {});
  readonly #shown: ReadyCase;
  readonly #layers: CaseLayers;
  readonly #listener: LayersListener;
  readonly #none = quiet(t("layers.none"));
  readonly #list = h("ul", { class: "layers", "aria-label": t("panel.layers") });
  readonly #note = h("p", { class: "quiet layers-note", role: "status" });
  readonly #chosenWords = status();
  readonly #kind: HTMLSelectElement;
  readonly #transform: HTMLSelectElement;
  readonly #name = h("input", {
    type: "text",
    id: "layer-name",
    maxlength: 64,
    autocomplete: "off",
    "aria-label": t("layer.name"),
  });
  readonly #transfer = new Transfer(t("layer.send"));
  readonly #form: HTMLFormElement;
  #added: readonly Layer[] = [];
  #told = "";
  #chosen: readonly File[] = [];
  #state: ViewState | null = null;

  constructor(shown: ReadyCase, layers: CaseLayers, listener: LayersListener) {
    this.#shown = shown;
    this.#layers = layers;
    this.#listener = listener;
    this.#kind = choice("layer-kind", t("layer.kind"), ["", ...LAYER_KINDS], (kind) =>
      t(`layer.kind.${kind || "auto"}`),
    );
    this.#transform = choice("layer-transform", t("layer.transform"), TRANSFORMS, (one) => t(`layer.transform.${one}`));
    const file = (id: string, attributes: Attributes, words: string): HTMLElement =>
      h(
        "label",
        { class: "file" },
        h("span", { class: "visually-hidden" }, words),
        fileInput(id, (files) => this.#choose(files), attributes),
        fileButton(words),
      );
    this.#form = h(
      "form",
      { class: "layer-form", submit: (event: SubmitEvent) => void this.#send(event) },
      quiet(t("layer.hint")),
      h(
        "div",
        { class: "row" },
        file("layer-files", { multiple: true }, t("upload.choose-files")),
        file("layer-folder", { webkitdirectory: true }, t("upload.choose-folder")),
      ),
      this.#chosenWords,
      line(t("layer.name"), this.#name),
      line(t("layer.kind"), this.#kind),
      line(t("layer.transform"), this.#transform),
      ...this.#transfer.parts,
    );
    this.element = h(
      "div",
      { class: "group-body" },
      this.#none,
      this.#list,
      this.slot,
      h("details", { class: "add-layer" }, h("summary", {}, t("layer.add")), this.#form),
      this.#note,
    );
  }

  /** Marks the layers that are shown. */
  show(state: ViewState): void {
    this.#state = state;
    for (const one of this.#list.querySelectorAll<HTMLButtonElement>("button[value]")) {
      const shown = one.value === "grey" ? state.layer?.id : state.overlay?.name;
      one.setAttribute("aria-pressed", String(shown === one.closest("li")?.dataset.id));
    }
  }

  /** Reports what became of a layer. */
  say(words: string): void {
    setText(this.#note, words);
  }

  /** Lists the layers. */
  tell({ layers }: LayerList): void {
    this.#added = layers.filter(isAdded);
    const told = JSON.stringify(this.#added);
    if (told === this.#told) return;
    this.#told = told;
    this.#none.hidden = this.#added.length > 0;
    // The focus stays on the same button of the same layer.
    const focused = document.activeElement;
    const place = focused?.closest<HTMLElement>(".layers li")?.dataset.id;
    const label = focused?.getAttribute("data-do");
    this.#list.replaceChildren(...this.#added.map((layer, at) => this.#item(layer, at)));
    this.#list.querySelector<HTMLElement>(`[data-id="${place}"] [data-do="${label}"]:not(:disabled)`)?.focus();
    if (this.#state) this.show(this.#state);
  }

  #item(layer: Layer, at: number): HTMLElement {
    const { id, name, kind, unit, state } = layer;
    const act = (
      what: Icon,
      key: "up" | "down" | "rename" | "delete",
      work: () => Promise<unknown>,
      isOff = false,
    ): HTMLElement => {
      const one = iconButton(what, t(`layer.${key}`, { name }), () => void this.#do(work));
      one.dataset.do = key;
      one.disabled = isOff;
      return one;
    };
    const show = (how: "grey" | "colours"): HTMLElement =>
      button(t(`layer.${how}`), () => this.#toggle(how, id), {
        value: how,
        "aria-pressed": "false",
        "aria-label": t(`layer.${how}.of`, { name }),
        "data-do": how,
      });
    const move = (place: number) => (): Promise<unknown> => changeLayer(this.#shown.id, id, { place });
    return h(
      "li",
      { "data-id": id, "data-state": state },
      h(
        "p",
        { class: "layer-name" },
        h("strong", {}, name),
        h("span", { class: "quiet" }, [t(`layer.kind.${kind}`), unit].filter(Boolean).join(" · ")),
        ...(kind === "mr" ? [this.#contrast(layer)] : []),
      ),
      h("p", { class: `quiet status${layer.quality === "review" ? " doubtful" : ""}` }, statusWords(layer)),
      h(
        "div",
        { class: "row" },
        ...(isReady(layer) ? [...(greyOf(layer) ? [show("grey")] : []), show("colours")] : []),
        act("up", "up", move(at - 1), at === 0),
        act("down", "down", move(at + 1), at + 1 === this.#added.length),
        act("edit", "rename", () => this.#rename(layer)),
        act("trash", "delete", () => this.#delete(layer)),
      ),
    );
  }

  /** The contrast of an MR, which can be stated: the newest FLAIR has a map. */
  #contrast({ id, name, contrast }: Layer): HTMLElement {
    const values = contrast ? CONTRASTS : (["unknown", ...CONTRASTS] as const);
    const words = t("layer.contrast.of", { name });
    const take = (wanted: Contrast | "unknown"): void => {
      if (wanted !== "unknown") void this.#do(() => changeLayer(this.#shown.id, id, { contrast: wanted }));
    };
    const select = choice(`layer-contrast-${id}`, words, values, (one) => t(`layer.contrast.${one}`), take);
    select.value = contrast ?? "unknown";
    select.dataset.do = "contrast";
    return select;
  }

  #toggle(how: "grey" | "colours", id: string): void {
    if (how === "colours") return this.#listener.colours(id);
    this.#listener.grey(this.#state?.layer?.id === id ? null : id);
  }

  async #rename({ id, name }: Layer): Promise<void> {
    const wanted = await askText(t("layer.rename", { name }), t("layer.name"), name);
    if (wanted && wanted !== name) await changeLayer(this.#shown.id, id, { name: wanted });
  }

  async #delete({ id, name }: Layer): Promise<void> {
    if (!(await confirmDelete(t("layer.delete-title"), t("layer.delete-text", { name })))) return;
    await deleteLayer(this.#shown.id, id);
    this.#listener.announce(t("layer.deleted", { name }));
    if (this.#state?.layer?.id === id) this.#listener.grey(null);
    if (this.#state?.overlay?.name === id) this.#listener.colours(id);
  }

  /** Changes something of the layers, and lists them again. */
  async #do(work: () => Promise<unknown>): Promise<void> {
    this.say("");
    try {
      await work();
      await this.#layers.again();
    } catch (problem) {
      this.say(problemWords(problem));
    }
  }

  // -- Another layer

  #choose(files: readonly File[]): void {
    this.#chosen = files;
    const { volumes, labels } = sortLayers(this.#chosen);
    const words = t("layer.chosen", { count: volumes.length });
    setText(this.#chosenWords, labels ? `${words} ${t("layer.chosen-labels")}` : words);
  }

  async #send(event: SubmitEvent): Promise<void> {
    event.preventDefault();
    const { volumes, labels } = sortLayers(this.#chosen);
    if (volumes.length === 0) return this.say(t("upload.nothing"));
    this.say("");
    const [name, kind] = [this.#name.value.trim(), LAYER_KINDS.find((one) => one === this.#kind.value)];
    try {
      await this.#transfer.run(async (signal, observe) => {
        for (const files of volumes) {
          const wish = wishOf(files, {
            ...(name && { name }),
            ...(kind && { kind }),
            transform: this.#transform.value,
          });
          const taken = this.#added.map((layer) => layer.name);
          const named = wish.name && !(name && volumes.length === 1) ? { name: freeName(wish.name, taken) } : {};
          const { created, wasThere } = await sendLayer(
            this.#shown.id,
            files,
            { ...wish, ...named },
            wish.kind === "labels" ? labels : null,
            [signal, observe()],
          );
          this.say(t(wasThere ? "layer.was-there" : "layer.sent", { name: created.name }));
          void this.#layers.again().catch(() => {});
        }
      });
      this.#form.reset();
      this.#chosen = [];
      setText(this.#chosenWords, "");
    } catch (problem) {
      this.say(this.#transfer.isCancelled ? t("upload.cancelled") : problemWords(problem));
    }
  }
}

/** How far a layer is, and how it is placed. */
function statusWords(layer: Layer): string {
  const { state, origin, verdict, quality, reason, error } = layer;
  if (state === "failed") return failureWords(error);
  if (state !== "ready") return t(state === "queued" ? "layer.queued" : "layer.preparing");
  const placed = t(verdict === "unchanged" ? "origin.unchanged" : `origin.${origin ?? "header"}`);
  if (quality !== "review") return sentence(placed);
  // The reason is in the server's language.
  const why = reason && spoken() === "en" ? ` ${sentence(reason)}` : "";
  return sentence(t("origin.review", { origin: placed })) + why;
}
