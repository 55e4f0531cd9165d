// The form that adds a case: files chosen or dropped, sent under fixed names.

import { type Uploaded, uploadCase } from "../base/api.ts";
import type { Case } from "../model/case.ts";
import { h, setText, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { caseIdentity } from "../base/case-words.ts";
import { problemWords } from "../base/problem-words.ts";
import { confirmRename, offerLayers } from "./dialogs.ts";
import { fileButton, fileInput } from "./fields.ts";
import { type Offer, sendLayer, wishOf } from "./layer-form.ts";
import { Transfer } from "./transfer.ts";
import { type Sorted, freeName, looksLikeMask, sortFiles, uploadName } from "./upload-files.ts";

/** What the form is in. */
interface UploadBox {
  /** The result of the last upload; outside of the form, which is closed by then. */
  readonly done: HTMLElement;
  close(): void;
}

export class UploadForm {
  readonly #box: UploadBox;
  readonly #onCreated: (one: Case, wasThere: boolean) => Promise<void>;
  readonly element: HTMLFormElement;
  readonly #chosen = h("p", { class: "chosen", role: "status" });
  readonly #names = h("p", { class: "chosen-names quiet", hidden: true });
  readonly #note = h("p", { id: "upload-note", role: "alert" });
  readonly #transfer = new Transfer(t("upload.send"));
  readonly #volume: HTMLInputElement;
  readonly #folder: HTMLInputElement;
  readonly #mask: HTMLInputElement;
  readonly #name = h("input", { type: "text", id: "upload-name", maxlength: 200, autocomplete: "off" });
  readonly #radius = h("input", { type: "number", min: 0, max: 50, step: 0.5, value: 10 });
  #files: readonly File[] = [];
  #maskFile: File | null = null;
  /** What is being sent; what is chosen meanwhile is the next case. */
  #sending: { readonly files: readonly File[]; readonly mask: File | null } | null = null;

  constructor(box: UploadBox, onCreated: (one: Case, wasThere: boolean) => Promise<void>) {
    this.#box = box;
    this.#onCreated = onCreated;
    const take = (files: readonly File[]): void => this.#take(files);
    this.#volume = fileInput("upload-volume", take, { multiple: true });
    this.#folder = fileInput("upload-folder", take, { webkitdirectory: true });
    this.#mask = fileInput("upload-mask", ([file = null]) => this.#takeMask(file), { accept: ".nii,.gz" });
    const field = (label: string, input: HTMLElement, hint: string): HTMLElement =>
      h("label", {}, label, input, h("span", { class: "quiet" }, hint));
    const file = (label: string, input: HTMLElement, button: string, hint: string): HTMLElement =>
      h("label", {}, label, input, fileButton(button), h("span", { class: "quiet" }, hint));
    this.element = h(
      "form",
      { id: "upload", submit: (event: SubmitEvent) => void this.#submit(event) },
      h(
        "div",
        {},
        h("p", { class: "drop-hint" }, t("upload.drop")),
        file(t("upload.volume"), this.#volume, t("upload.choose-files"), t("upload.volume-hint")),
        file(t("upload.folder"), this.#folder, t("upload.choose-folder"), t("upload.folder-hint")),
        file(t("upload.mask"), this.#mask, t("upload.choose-files"), t("upload.mask-hint")),
        field(t("upload.name"), this.#name, t("upload.name-hint")),
        h(
          "details",
          {},
          h("summary", {}, t("upload.more")),
          field(t("upload.radius"), this.#radius, t("upload.radius-hint")),
        ),
      ),
      // In sight, however far the form is scrolled.
      h("section", {}, this.#chosen, this.#names, this.#note, ...this.#transfer.parts),
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
    this.#beginNext();
    // A label was meant for the files that these replace.
    if (this.#files.length > 0) this.#name.value = "";
    this.#files = files;
    this.#tell();
  }

  #takeMask(file: File | null): void {
    this.#beginNext();
    this.#maskFile = file;
    this.#tell();
  }

  /** Empties the form for the next case, if the one in it is being sent. */
  #beginNext(): void {
    if (this.#isSending()) [this.#files, this.#maskFile, this.#name.value] = [[], null, ""];
  }

  /** Whether what is chosen is what is being sent. */
  #isSending(): boolean {
    return this.#sending?.files === this.#files && this.#sending.mask === this.#maskFile;
  }

  #tell(): void {
    const sorted = sortFiles(this.#files, this.#maskFile);
    setText(this.#note, sorted.trouble ? t(sorted.trouble) : "");
    const size = (bytes: number): string => `${number(bytes / 1e6, 1)} MB`;
    // Shown here alone: a file's name may hold the patient's, and is never sent.
    const { volume, dicom, mask, layers } = sorted;
    const taken = [volume, mask, ...layers, ...dicom].filter((file) => file !== null);
    // What is left aside stands in brackets.
    const aside = this.#files.filter((file) => !taken.includes(file)).map(({ name }) => `(${name})`);
    tell(this.#names, [...taken.map(({ name }) => name), ...aside].join("\n"));
    const parts = [
      volume && t("upload.chosen-volume", { size: size(volume.size) }),
      dicom.length > 0 &&
        t("upload.chosen-dicom", { count: dicom.length, size: size(dicom.reduce((sum, file) => sum + file.size, 0)) }),
      mask && t("upload.chosen-mask", { size: size(mask.size) }),
      layers.length > 0 && t("upload.chosen-others", { count: layers.length }),
    ].filter((part): part is string => typeof part === "string");
    setText(this.#chosen, parts.join(" · "));
  }

  async #submit(event: SubmitEvent): Promise<void> {
    event.preventDefault();
    const sorted = sortFiles(this.#files, this.#maskFile);
    if (sorted.trouble) return setText(this.#note, t(sorted.trouble));
    this.#sending = { files: this.#files, mask: this.#maskFile };
    for (const line of [this.#note, this.#box.done]) setText(line, "");
    try {
      const { created, wasThere } = await this.#sendAndName(sorted);
      const layers = await this.#sendLayers(created.id, offersOf(sorted, created));
      if (this.#isSending()) this.#forget();
      const words = t(wasThere ? "upload.was-there" : "upload.done", { title: caseIdentity(created) });
      setText(this.#box.done, [words, ...layers].join(" "));
      await this.#onCreated(created, wasThere);
    } catch (problem) {
      setText(this.#note, this.#transfer.isCancelled ? t("upload.cancelled") : problemWords(problem));
    } finally {
      this.#sending = null;
    }
  }

  /** Empties and closes the form. */
  #forget(): void {
    this.element.reset();
    this.#files = [];
    this.#maskFile = null;
    this.#tell();
    this.#box.close();
  }

  /** Adds those of the other volumes that are wanted as layers, one after the other; what became of them in words. */
  async #sendLayers(id: string, offers: readonly Offer[]): Promise<readonly string[]> {
    const wanted = offers.length > 0 ? await offerLayers(offers.map(({ title }) => title)) : [];
    const words: string[] = [];
    for (const [at, { title, files, wish }] of offers.entries()) {
      if (!wanted.includes(at)) continue;
      try {
        await this.#transfer.run((signal, observe) => sendLayer(id, files, wish, null, [signal, observe()]));
        words.push(t("offer.added", { name: title }));
      } catch (problem) {
        const why = this.#transfer.isCancelled ? t("upload.cancelled") : problemWords(problem);
        words.push(t("offer.failed", { name: title, why }));
      }
    }
    return words;
  }

  /** Sends the files. A case that is there already keeps its label, unless another one is wanted. */
  async #sendAndName(sorted: Sorted<File>): Promise<Uploaded> {
    const [name, radius_mm] = [this.#name.value.trim(), this.#radius.valueAsNumber];
    const send = (keepsName: boolean): Promise<Uploaded> =>
      this.#transfer.run((signal, observe) =>
        uploadCase(bodyOf(sorted, { name, radius_mm, keepsName }), signal, observe()),
      );
    const uploaded = await send(true);
    if (!uploaded.wasThere || name === "" || name === uploaded.created.name) return uploaded;
    return (await confirmRename(caseIdentity(uploaded.created), name)) ? send(false) : uploaded;
  }
}

/** The volumes that came with a case and are not part of it. */
function offersOf(sorted: Sorted<File>, { dicom }: Case): Offer[] {
  const names: string[] = [];
  const files = sorted.volume ? [sorted.volume] : sorted.dicom;
  const others = dicom?.others.filter((series) => series.is_volume) ?? [];
  return [
    ...sorted.layers.map((file) => {
      const wish = wishOf([file], {});
      const name = freeName(wish.name ?? "MR", names);
      names.push(name);
      // Shown here alone, as above.
      return { title: `${name} (${file.name})`, files: [file], wish: { ...wish, name } };
    }),
    ...others.map(({ name, number: place, token }) => ({
      title: [name || "MR", place === null ? "" : t("offer.series", { number: place })].filter(Boolean).join(", "),
      files,
      wish: { series: token },
    })),
  ];
}

/** The multipart body. The files have fixed names, because a file's own name may contain the patient's. */
function bodyOf(
  sorted: Sorted<File>,
  { name, radius_mm, keepsName }: { readonly name: string; readonly radius_mm: number; readonly keepsName: boolean },
): FormData {
  const parameters = {
    ...(Number.isFinite(radius_mm) && { closing_radius_mm: radius_mm }),
    ...(name && { name }),
    keep_name: keepsName,
  };
  const body = new FormData();
  body.append("parameters", new Blob([JSON.stringify(parameters)], { type: "application/json" }));
  if (sorted.volume) body.append("volume", sorted.volume, uploadName("volume", sorted.volume.name));
  sorted.dicom.forEach((file, index) => body.append("dicom", file, `${index + 1}.dcm`));
  if (sorted.mask) body.append("mask", sorted.mask, uploadName("mask", sorted.mask.name));
  return body;
}
