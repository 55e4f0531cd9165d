// Where cases are added: files chosen or dropped, sent under fixed names.

import { computed, signal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";

import { type Uploaded, upload as sendForm } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case } from "../model/case.ts";
import { confirmRename, offerLayers } from "./dialogs.tsx";
import { FileInput } from "./fields.tsx";
import { type Offer, sendLayer, wishOf } from "./layer-form.ts";
import { Sending, Transfer } from "./transfer.tsx";
import { type Sorted, freeName, looksLikeMask, ofSubject, partName, sortFiles, uploadName } from "./upload-files.ts";

interface Chosen {
  readonly files: readonly File[];
  readonly mask: File | null;
}
const NOTHING: Chosen = { files: [], mask: null };

interface Fields {
  readonly name: string;
  readonly radius_mm: number;
}

export class Upload {
  readonly isOpen = signal(false);
  /** The result of the last upload; outside of the form, which is closed by then. */
  readonly done = signal("");
  readonly chosen = signal(NOTHING);
  readonly sorted = computed(() => sortFiles(this.chosen.value.files, this.chosen.value.mask));
  readonly note = signal("");
  readonly transfer = new Sending();
  /** Counts how often the fields are to be emptied. */
  readonly emptied = signal(0);
  readonly #onCreated: (one: Case, wasThere: boolean) => Promise<void>;
  /** What is being sent; what is chosen meanwhile is the next case. */
  #sending: Chosen | null = null;
  /** Whether the files that are being chosen are sent without a further step. */
  #isAtOnce = false;

  constructor(onCreated: (one: Case, wasThere: boolean) => Promise<void>) {
    this.#onCreated = onCreated;
  }

  /** Asks for files as the browser does, and sends them at once. */
  choose(): void {
    this.isOpen.value = true;
    this.#isAtOnce = true;
    const input = document.querySelector<HTMLInputElement>("#upload-volume");
    // What is chosen later in the form waits for its label and its mask.
    input?.addEventListener("cancel", () => (this.#isAtOnce = false), { once: true });
    input?.click();
  }

  drop(files: readonly File[]): void {
    this.isOpen.value = true;
    this.#isAtOnce = false;
    const [only] = files;
    // A mask alone joins the volume that is there.
    if (only && files.length === 1 && looksLikeMask(only) && this.chosen.peek().files.length > 0) this.takeMask(only);
    else this.take(files);
    document.getElementById("add")?.scrollIntoView({ block: "nearest" });
  }

  take(files: readonly File[]): void {
    this.#beginNext();
    // A label was meant for the files that these replace.
    if (this.chosen.peek().files.length > 0) this.emptied.value += 1;
    this.#put({ ...this.chosen.peek(), files });
    const isAtOnce = this.#isAtOnce && !this.sorted.peek().trouble;
    this.#isAtOnce = false;
    if (isAtOnce) void this.submit({ name: "", radius_mm: NaN });
  }

  takeMask(mask: File | null): void {
    this.#beginNext();
    this.#put({ ...this.chosen.peek(), mask });
  }

  async submit(fields: Fields): Promise<void> {
    const sorted = this.sorted.peek();
    if (sorted.trouble) return void (this.note.value = t(sorted.trouble));
    this.#sending = this.chosen.peek();
    this.note.value = "";
    this.done.value = "";
    try {
      const { created, wasThere } = await this.#sendAndName(sorted, fields);
      const layers = await this.#sendLayers(created.id, offersOf(sorted, created));
      if (this.chosen.peek() === this.#sending) this.#forget();
      const words = t(wasThere ? "upload.was-there" : "upload.done", { title: caseIdentity(created) });
      this.done.value = [words, ...layers].join(" ");
      await this.#onCreated(created, wasThere);
    } catch (problem) {
      this.note.value = this.transfer.isCancelled ? t("upload.cancelled") : problemWords(problem);
    } finally {
      this.#sending = null;
    }
  }

  /** Empties the form for the next case, if the one in it is being sent. */
  #beginNext(): void {
    if (this.chosen.peek() === this.#sending) this.#empty();
  }

  #put(chosen: Chosen): void {
    this.chosen.value = chosen;
    const { trouble } = this.sorted.peek();
    this.note.value = trouble ? t(trouble) : "";
  }

  #empty(): void {
    this.chosen.value = NOTHING;
    this.emptied.value += 1;
  }

  #forget(): void {
    this.#empty();
    this.isOpen.value = false;
  }

  /** Adds those of the other volumes that are wanted as layers, one after the other; what became of them in words. */
  async #sendLayers(id: string, offers: readonly Offer[]): Promise<readonly string[]> {
    const wanted = offers.length > 0 ? await offerLayers(offers.map(({ title }) => title)) : [];
    const words: string[] = [];
    for (const [at, { title, files, wish }] of offers.entries()) {
      if (!wanted.includes(at)) continue;
      try {
        await this.transfer.run((given, observe) => sendLayer(id, files, wish, null, [given, observe()]));
        words.push(t("offer.added", { name: title }));
      } catch (problem) {
        const why = this.transfer.isCancelled ? t("upload.cancelled") : problemWords(problem);
        words.push(t("offer.failed", { name: title, why }));
      }
    }
    return words;
  }

  /** Sends the files. A case that is there already keeps its label, unless another one is wanted. */
  async #sendAndName(sorted: Sorted<File>, { name, radius_mm }: Fields): Promise<Uploaded> {
    const send = (keepsName: boolean): Promise<Uploaded> =>
      this.transfer.run((given, observe) =>
        sendForm<Case>("v1/cases", bodyOf(sorted, { name, radius_mm, keepsName }), given, observe()),
      );
    const uploaded = await send(true);
    if (!uploaded.wasThere || name === "" || name === uploaded.created.name) return uploaded;
    return (await confirmRename(caseIdentity(uploaded.created), name)) ? send(false) : uploaded;
  }
}

export function UploadForm({ upload }: { readonly upload: Upload }) {
  const name = useRef<HTMLInputElement>(null);
  const radius = useRef<HTMLInputElement>(null);
  const emptied = upload.emptied.value;
  useLayoutEffect(() => {
    if (name.current) name.current.value = "";
  }, [emptied]);
  const submit = (event: SubmitEvent): void => {
    event.preventDefault();
    const radius_mm = radius.current?.valueAsNumber ?? NaN;
    void upload.submit({ name: name.current?.value.trim() ?? "", radius_mm });
  };
  return (
    <details
      id="add"
      class="add"
      open={upload.isOpen.value}
      onToggle={({ currentTarget }) => (upload.isOpen.value = currentTarget.open)}
    >
      <summary>{t("upload.title")}</summary>
      <form id="upload" onSubmit={submit}>
        <div>
          <p class="drop-hint">{t("upload.drop")}</p>
          <FileInput
            id="upload-volume"
            label={t("upload.volume")}
            words={t("upload.choose-files")}
            hint={t("upload.volume-hint")}
            multiple
            onFiles={(files) => upload.take(files)}
          />
          <FileInput
            id="upload-folder"
            label={t("upload.folder")}
            words={t("upload.choose-folder")}
            hint={t("upload.folder-hint")}
            webkitdirectory
            onFiles={(files) => upload.take(files.map((file) => ofSubject(file, file.webkitRelativePath)))}
          />
          <FileInput
            id="upload-mask"
            label={t("upload.mask")}
            words={t("upload.choose-files")}
            hint={t("upload.mask-hint")}
            accept=".nii,.gz,.mgh,.mgz"
            onFiles={([mask = null]) => upload.takeMask(mask)}
          />
          <label>
            {t("upload.name")}
            <input type="text" id="upload-name" ref={name} maxLength={200} autocomplete="off" />
            <span class="quiet">{t("upload.name-hint")}</span>
          </label>
          <details>
            <summary>{t("upload.more")}</summary>
            <label>
              {t("upload.radius")}
              <input type="number" ref={radius} min={0} max={50} step={0.5} defaultValue="10" />
              <span class="quiet">{t("upload.radius-hint")}</span>
            </label>
          </details>
        </div>
        {/* In sight, however far the form is scrolled. */}
        <section>
          <ChosenFiles upload={upload} />
          <p id="upload-note" role="alert">
            {upload.note.value}
          </p>
          <Transfer transfer={upload.transfer} words={t("upload.send")} />
        </section>
      </form>
    </details>
  );
}

/** What is chosen, in words, and by name: a name may hold the patient's, is shown here alone, and is never sent. */
function ChosenFiles({ upload }: { readonly upload: Upload }) {
  const { volume, dicom, mask, layers } = upload.sorted.value;
  const size = (bytes: number): string => `${number(bytes / 1e6, 1)} MB`;
  const taken = [volume, mask, ...layers, ...dicom].filter((file) => file !== null);
  // What is left aside stands in brackets.
  const aside = upload.chosen.value.files.filter((file) => !taken.includes(file)).map(({ name }) => `(${name})`);
  const names = [...taken.map(({ name }) => name), ...aside].join("\n");
  const dicomSize = size(dicom.reduce((sum, file) => sum + file.size, 0));
  const parts = [
    volume && t("upload.chosen-volume", { size: size(volume.size) }),
    dicom.length > 0 && t("upload.chosen-dicom", { count: dicom.length, size: dicomSize }),
    mask && t("upload.chosen-mask", { size: size(mask.size) }),
    layers.length > 0 && t("upload.chosen-others", { count: layers.length }),
  ];
  return (
    <>
      <p class="chosen" role="status">
        {parts.filter(Boolean).join(" · ")}
      </p>
      <p class="chosen-names quiet" hidden={names === ""}>
        {names}
      </p>
    </>
  );
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
  sorted.dicom.forEach((file, index) => body.append("dicom", file, partName(file.name, index)));
  if (sorted.mask) body.append("mask", sorted.mask, uploadName("mask", sorted.mask.name));
  return body;
}
