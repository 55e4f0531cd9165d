// The form that adds a case: files chosen or dropped, sent under fixed names.

import { type UploadProgress, type Uploaded, uploadCase } from "../base/api.ts";
import type { Case } from "../model/case.ts";
import { h, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { caseTitle } from "../base/case-words.ts";
import { problemWords } from "../base/problem-words.ts";
import { confirmRename } from "./dialogs.ts";
import { type Sorted, looksLikeMask, sortFiles, uploadName } from "./upload-files.ts";

/** What the form is in. */
export interface UploadBox {
  /** Says what became of the last upload; beside the form, which is closed by then. */
  readonly done: HTMLElement;
  close(): void;
}

export class UploadForm {
  readonly #box: UploadBox;
  readonly #onCreated: (one: Case, wasThere: boolean) => Promise<void>;
  readonly element: HTMLFormElement;
  readonly #chosen = h("p", { class: "chosen", role: "status" });
  readonly #names = h("p", { class: "chosen-names quiet", hidden: true });
  readonly #sent = h("p", { class: "quiet sent", hidden: true });
  readonly #note = h("p", { id: "upload-note", role: "alert" });
  readonly #bar = h("progress", { max: 1, value: 0, hidden: true, "aria-label": t("upload.progress") });
  readonly #send: HTMLButtonElement;
  readonly #cancel: HTMLButtonElement;
  readonly #volume: HTMLInputElement;
  readonly #folder: HTMLInputElement;
  readonly #mask: HTMLInputElement;
  readonly #name = h("input", { type: "text", id: "upload-name", maxlength: 200, autocomplete: "off" });
  readonly #radius = h("input", { type: "number", id: "upload-radius", min: 0, max: 50, step: 0.5, value: 10 });
  #files: readonly File[] = [];
  #maskFile: File | null = null;
  #abort: AbortController | null = null;

  constructor(box: UploadBox, onCreated: (one: Case, wasThere: boolean) => Promise<void>) {
    this.#box = box;
    this.#onCreated = onCreated;
    this.#volume = h("input", {
      type: "file",
      id: "upload-volume",
      multiple: true,
      change: () => this.#take([...(this.#volume.files ?? [])]),
    });
    this.#folder = h("input", {
      type: "file",
      id: "upload-folder",
      webkitdirectory: true,
      change: () => this.#take([...(this.#folder.files ?? [])]),
    });
    this.#mask = h("input", {
      type: "file",
      id: "upload-mask",
      accept: ".nii,.gz",
      change: () => this.#takeMask(this.#mask.files?.[0] ?? null),
    });
    this.#send = h("button", { type: "submit", class: "primary" }, t("upload.send"));
    this.#cancel = h("button", { type: "button", hidden: true, click: () => this.#abort?.abort() }, t("upload.cancel"));
    const field = (label: string, input: HTMLElement, hint: string): HTMLElement =>
      h("label", {}, label, input, h("span", { class: "quiet" }, hint));
    const file = (label: string, input: HTMLElement, button: string, hint: string): HTMLElement =>
      h(
        "label",
        {},
        label,
        input,
        h("span", { class: "file-button", "aria-hidden": "true" }, button),
        h("span", { class: "quiet" }, hint),
      );
    this.element = h(
      "form",
      { id: "upload", submit: (event: SubmitEvent) => void this.#submit(event) },
      h("p", { class: "drop-hint" }, t("upload.drop")),
      file(t("upload.volume"), this.#volume, t("upload.choose-files"), t("upload.volume-hint")),
      file(t("upload.folder"), this.#folder, t("upload.choose-folder"), t("upload.folder-hint")),
      file(t("upload.mask"), this.#mask, t("upload.choose-files"), t("upload.mask-hint")),
      this.#chosen,
      this.#names,
      field(t("upload.name"), this.#name, t("upload.name-hint")),
      field(t("upload.radius"), this.#radius, t("upload.radius-hint")),
      h("div", { class: "row" }, this.#send, this.#cancel),
      this.#bar,
      this.#sent,
      this.#note,
    );
  }

  /** Files that were dropped on the page. */
  drop(files: readonly File[]): void {
    const [only] = files;
    // A mask alone joins the volume that is there.
    if (only && files.length === 1 && looksLikeMask(only) && this.#files.length > 0) this.#takeMask(only);
    else this.#take(files);
  }

  #take(files: readonly File[]): void {
    this.#files = files;
    this.#tell();
  }

  #takeMask(file: File | null): void {
    this.#maskFile = file;
    this.#tell();
  }

  #tell(): void {
    const sorted = sortFiles(this.#files, this.#maskFile);
    setText(this.#note, sorted.trouble ? t(sorted.trouble) : "");
    const size = (bytes: number): string => `${number(bytes / 1e6, 1)} MB`;
    // Shown here alone: a file's name may hold the patient's, and is never sent.
    const named = [sorted.volume, sorted.mask].filter((file) => file !== null).map((file) => file.name);
    this.#names.hidden = named.length === 0;
    setText(this.#names, named.join("\n"));
    const parts = [
      sorted.volume && t("upload.chosen-volume", { size: size(sorted.volume.size) }),
      sorted.dicom.length > 0 &&
        t("upload.chosen-dicom", {
          count: sorted.dicom.length,
          size: size(sorted.dicom.reduce((sum, file) => sum + file.size, 0)),
        }),
      sorted.mask && t("upload.chosen-mask", { size: size(sorted.mask.size) }),
    ].filter((part): part is string => typeof part === "string");
    setText(this.#chosen, parts.join(" · "));
  }

  async #submit(event: SubmitEvent): Promise<void> {
    event.preventDefault();
    const sorted = sortFiles(this.#files, this.#maskFile);
    if (sorted.trouble) return setText(this.#note, t(sorted.trouble));
    this.#abort = new AbortController();
    this.#busy(true);
    try {
      const { created, wasThere } = await this.#sendAndName(sorted, this.#abort.signal);
      this.element.reset();
      this.#files = [];
      this.#maskFile = null;
      this.#tell();
      setText(this.#box.done, t(wasThere ? "upload.was-there" : "upload.done", { title: caseTitle(created) }));
      this.#box.close();
      await this.#onCreated(created, wasThere);
    } catch (problem) {
      setText(this.#note, this.#abort.signal.aborted ? t("upload.cancelled") : problemWords(problem));
    } finally {
      this.#busy(false);
    }
  }

  /** Sends the files. A case that is there already keeps its label, unless another one is wanted. */
  async #sendAndName(sorted: Sorted<File>, signal: AbortSignal): Promise<Uploaded> {
    const send = (keepsName: boolean): Promise<Uploaded> =>
      uploadCase(this.#bodyOf(sorted, keepsName), signal, this.#teller());
    const uploaded = await send(true);
    const name = this.#name.value.trim();
    if (!uploaded.wasThere || name === "" || name === uploaded.created.name) return uploaded;
    return (await confirmRename(caseTitle(uploaded.created), name)) ? send(false) : uploaded;
  }

  /** Tells how much is sent, and when all will be. */
  #teller(): (progress: UploadProgress) => void {
    const begun = performance.now();
    return ({ loaded, total }) => {
      const share = total > 0 ? loaded / total : 0;
      this.#bar.value = share;
      const seconds = share > 0 ? ((performance.now() - begun) / 1000) * (1 / share - 1) : NaN;
      const [sent, all] = [loaded, total].map((bytes) => number(bytes / 1e6, 1));
      const words = t("upload.sent", { sent: sent ?? "", all: all ?? "", share: number(100 * share) });
      const left = share < 1 && seconds >= 1 ? t("upload.left", { seconds: number(Math.ceil(seconds)) }) : "";
      setText(this.#sent, share < 1 ? `${words}${left}` : t("upload.checking"));
    };
  }

  #busy(busy: boolean): void {
    this.#send.disabled = busy;
    this.#cancel.hidden = !busy;
    for (const element of [this.#bar, this.#sent]) element.hidden = !busy;
    setText(this.#sent, "");
    this.#bar.value = 0;
    if (!busy) return;
    for (const line of [this.#note, this.#box.done]) setText(line, "");
  }

  /** The multipart body. The files go under fixed names, for a file's own name may hold the patient's. */
  #bodyOf(sorted: Sorted<File>, keepsName: boolean): FormData {
    const parameters: { closing_radius_mm?: number; name?: string; keep_name?: boolean } = {};
    if (Number.isFinite(this.#radius.valueAsNumber)) parameters.closing_radius_mm = this.#radius.valueAsNumber;
    if (this.#name.value.trim()) parameters.name = this.#name.value.trim();
    if (keepsName) parameters.keep_name = true;
    const body = new FormData();
    body.append("parameters", new Blob([JSON.stringify(parameters)], { type: "application/json" }));
    if (sorted.volume) body.append("volume", sorted.volume, uploadName("volume", sorted.volume.name));
    sorted.dicom.forEach((file, index) => body.append("dicom", file, `${index + 1}.dcm`));
    if (sorted.mask) body.append("mask", sorted.mask, uploadName("mask", sorted.mask.name));
    return body;
  }
}
