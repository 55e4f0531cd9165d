// Where cases are added: the form is fetched when it is first opened, or when files are dropped.

import { h, setText } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case } from "../model/case.ts";
import { later } from "./later.ts";
import type { UploadForm } from "./upload.ts";

export class UploadSlot {
  readonly element: HTMLDetailsElement;
  readonly done = h("p", { id: "upload-done", class: "quiet", role: "status" });
  readonly #onCreated: (one: Case, wasThere: boolean) => Promise<void>;
  #form: Promise<UploadForm | null> | null = null;

  constructor(onCreated: (one: Case, wasThere: boolean) => Promise<void>) {
    this.#onCreated = onCreated;
    this.element = h(
      "details",
      { id: "add", class: "add", toggle: () => void this.#filled() },
      h("summary", {}, t("upload.title")),
    );
  }

  open(): void {
    this.element.open = true;
  }

  close(): void {
    this.element.open = false;
  }

  /** Asks for files as the browser does. */
  async choose(): Promise<void> {
    this.open();
    (await this.#filled())?.element.querySelector<HTMLInputElement>("input[type=file]")?.click();
  }

  /** Files that were dropped on the page. */
  async drop(files: readonly File[]): Promise<void> {
    this.open();
    (await this.#filled())?.drop(files);
    this.element.scrollIntoView({ block: "nearest" });
  }

  /** The form in its place; null, with a message, if it cannot be loaded. */
  #filled(): Promise<UploadForm | null> {
    return (this.#form ??= this.#fetched());
  }

  async #fetched(): Promise<UploadForm | null> {
    try {
      const form = new (await later()).UploadForm(this, this.#onCreated);
      this.element.append(form.element);
      setText(this.done, "");
      return form;
    } catch (problem) {
      this.#form = null;
      setText(this.done, problemWords(problem));
      return null;
    }
  }
}

/** Calls `hear` with files that are dropped anywhere on the page, including the files of dropped folders. */
export function hearDrops(target: HTMLElement, hear: (files: readonly File[]) => void): void {
  const hasFiles = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;
  target.addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    target.classList.add("dropping");
  });
  target.addEventListener("dragleave", (event) => {
    if (!(event.relatedTarget instanceof Node)) target.classList.remove("dropping");
  });
  target.addEventListener("drop", (event) => {
    target.classList.remove("dropping");
    if (!hasFiles(event) || !event.dataTransfer) return;
    event.preventDefault();
    // The items are gone when the event is over: their entries are taken now.
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.() ?? null);
    const plain = [...event.dataTransfer.files];
    void (entries.some((entry) => entry?.isDirectory) ? filesOf(entries) : Promise.resolve(plain)).then(hear, () =>
      hear(plain),
    );
  });
}

/** The most files of a dropped folder; a series has some hundreds. */
const MOST_FILES = 20_000;

async function filesOf(entries: readonly (FileSystemEntry | null)[]): Promise<File[]> {
  const files: File[] = [];
  const waiting = entries.filter((entry) => entry !== null);
  for (let entry = waiting.pop(); entry && files.length < MOST_FILES; entry = waiting.pop()) {
    if (entry.isFile)
      files.push(await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject)));
    else waiting.push(...(await entriesOf(entry as FileSystemDirectoryEntry)));
  }
  return files;
}

async function entriesOf(folder: FileSystemDirectoryEntry): Promise<FileSystemEntry[]> {
  const reader = folder.createReader();
  const all: FileSystemEntry[] = [];
  for (;;) {
    // It gives a hundred at a time, and none at the end.
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return all;
    all.push(...some);
  }
}
