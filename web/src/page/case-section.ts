// What is known of the case and its mask, and what can be made of it: the mask's outline, its files, versions.

import { changeCase, getCase, getDicom, getFile, handOver, makeVersion } from "../base/api.ts";
import { caseTitle, reasonWords, voxelWords } from "../base/case-words.ts";
import { h, setText, status } from "../base/dom.ts";
import { known, moment, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case, ReadyCase } from "../model/case.ts";
import { type MaskBlock, decodeMask } from "../model/mask.ts";
import { doubtsOf, qualityOf } from "../model/quality.ts";
import { MaskLayer } from "../panes/mask-layer.ts";
import type { SliceLayer } from "../panes/slice-parts.ts";
import { askText, maskDialog } from "./dialogs.ts";
import { fileStem } from "./export.ts";
import { button, row } from "./fields.ts";
import { saveFile } from "./picture-file.ts";

interface CaseSectionListener {
  /** Something is to be laid over each slice; null: nothing. */
  lay(make: (() => SliceLayer) | null): void;
  /** A version was made, or was there. */
  made(one: Case, wasThere: boolean): void;
}

/** Attributes of DICOM files that say which series it is, and when it was acquired. */
const SERIES = ["SeriesDescription", "ProtocolName", "AcquisitionDate"] as const;

export class CaseSection {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #listener: CaseSectionListener;
  readonly #facts = h("dl", { class: "point case-facts" });
  readonly #note = status();
  readonly #keep: HTMLInputElement;
  readonly #outline: HTMLInputElement;
  readonly #mask = h("input", { type: "file", accept: ".nii,.gz" });
  readonly #offset: HTMLInputElement;
  readonly #radius: HTMLInputElement;
  readonly #make: HTMLButtonElement;
  #block: MaskBlock | null = null;
  /** What is known of its series. */
  #series: readonly (readonly [string, string])[] = [];
  /** As far as it is known whether it is kept. */
  #age: Case;
  #asked: Promise<Case> | null = null;

  constructor(shown: ReadyCase, listener: CaseSectionListener) {
    this.#shown = this.#age = shown;
    this.#listener = listener;
    this.#keep = h("input", {
      type: "checkbox",
      id: "keep-case",
      change: () => void this.#tellAge(changeCase(shown.id, { kept: this.#keep.checked })),
    });
    this.#outline = h("input", { type: "checkbox", id: "mask-outline", change: () => void this.#showOutline() });
    this.#offset = h("input", {
      type: "number",
      id: "version-offset",
      min: -20,
      max: 20,
      step: 0.5,
      value: shown.offset_mm,
    });
    this.#radius = h("input", { type: "number", min: 0, max: 50, step: 0.5, value: shown.closing_radius_mm });
    this.#make = h("button", { type: "submit" }, t("version.make"));
    const chosen = h("span", { class: "quiet" }, t("version.mask-hint"));
    this.#mask.addEventListener("change", () => setText(chosen, this.#mask.files?.[0]?.name ?? t("version.mask-hint")));
    this.#tellFacts();
    // The list may know an earlier state of it.
    void this.#tellAge(getCase(shown.id));
    this.element = h(
      "div",
      { class: "group-body" },
      this.#facts,
      ...(shown.links?.dicom ? [row(button(t("case.ask-series"), () => void this.#tellSeries()))] : []),
      h("label", { class: "inline" }, this.#keep, t("case.keep")),
      h("label", { class: "inline" }, this.#outline, t("case.outline")),
      row(
        button(t("case.rename"), () => void this.#rename()),
        button(t("quality.look"), () => maskDialog(shown.id)),
        button(t("case.save-mask"), () => void this.#save("mask")),
        button(t("case.save-envelope"), () => void this.#save("envelope")),
      ),
      h(
        "form",
        { class: "version", submit: (event: SubmitEvent) => void this.#makeVersion(event) },
        h("h3", {}, t("version.title")),
        h("label", { class: "inline" }, t("version.offset"), this.#offset),
        h("label", { class: "inline" }, t("version.radius"), this.#radius),
        h(
          "label",
          { class: "file" },
          t("version.mask"),
          this.#mask,
          h("span", { class: "file-button", "aria-hidden": "true" }, t("upload.choose-files")),
          chosen,
        ),
        row(this.#make),
      ),
      this.#note,
    );
  }

  /** Renames the case and loads the page again: the label stands in many places. */
  async #rename(): Promise<void> {
    const name = await askText(t("case.rename"), t("case.label"), this.#shown.name ?? "");
    if (!name) return;
    try {
      await changeCase(this.#shown.id, { name });
      handOver();
      location.reload();
    } catch (problem) {
      setText(this.#note, problemWords(problem));
    }
  }

  /** Whether it is kept, and until when it stays if it is not. */
  async #tellAge(asked: Promise<Case>): Promise<void> {
    this.#asked = asked;
    try {
      const now = await asked;
      if (this.#asked === asked) this.#age = now;
    } catch (problem) {
      setText(this.#note, problemWords(problem));
    }
    if (this.#asked !== asked) return;
    this.#keep.checked = this.#age.kept;
    this.#tellFacts();
  }

  #tellFacts(): void {
    const { volume, envelope_ml, max_depth_mm, mask_kind } = this.#shown;
    const quality = qualityOf(this.#shown);
    const found = quality ? doubtsOf(quality) : [];
    const doubts = found.length > 0 ? found : [quality?.state ?? ("unknown" as const)];
    const method = known(`method.${quality?.method ?? ""}`);
    const brain_ml = quality?.numbers?.brain_ml;
    const missing = volume.interpolated_slices?.length ?? 0;
    const facts: (readonly [string, string])[] = [
      [t("case.label"), caseTitle(this.#shown)],
      [t("case.uploaded"), moment(this.#shown.created_at)],
      ...(this.#age.expires_at ? [[t("case.expires"), moment(this.#age.expires_at)] as const] : []),
      ...(volume.sequence ? [[t("case.sequence"), volume.sequence] as const] : []),
      ...this.#series,
      [t("case.volume"), `${volume.size.map((side) => number(side)).join(" × ")}, ${voxelWords(this.#shown)}`],
      ...(missing > 0 ? [[t("case.interpolated"), number(missing)] as const] : []),
      [
        t("case.mask"),
        [method && t(method), brain_ml !== undefined && `${number(brain_ml)} ml`].filter(Boolean).join(", ") || "–",
      ],
      [
        t("case.verdict"),
        [...doubts.map((doubt) => t(`quality.${doubt}`)), ...(quality ? reasonWords(quality) : [])].join("\n"),
      ],
      [
        t("case.radius"),
        mask_kind === "envelope" ? t("case.not-closed") : `${number(this.#shown.closing_radius_mm, 1)} mm`,
      ],
      ...(this.#shown.offset_mm === 0 ? [] : [[t("case.offset"), `${number(this.#shown.offset_mm, 1)} mm`] as const]),
      [t("case.envelope"), `${number(envelope_ml)} ml, ${t("case.deep", { depth: number(max_depth_mm, 1) })}`],
    ];
    this.#facts.replaceChildren(...facts.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
  }

  /** The series is patient data: it is asked for by a hand alone. */
  async #tellSeries(): Promise<void> {
    try {
      const found = await getDicom(this.#shown.id);
      // A date of DICOM has no hyphens.
      const shown = (text = ""): string => text.replace(/^(\d{4})(\d\d)(\d\d)$/, "$1-$2-$3");
      this.#series = SERIES.filter((key) => found[key]).map((key) => [t(`case.${key}`), shown(found[key])]);
      this.#tellFacts();
      setText(this.#note, "");
    } catch (problem) {
      setText(this.#note, problemWords(problem));
    }
  }

  async #showOutline(): Promise<void> {
    try {
      if (this.#outline.checked) this.#block ??= await this.#fetchMask();
      const mask = this.#outline.checked ? this.#block : null;
      this.#listener.lay(mask && (() => new MaskLayer(mask)));
    } catch (problem) {
      this.#outline.checked = false;
      setText(this.#note, problemWords(problem));
    }
  }

  async #fetchMask(): Promise<MaskBlock> {
    const packed = await getFile(`${this.#shown.id}/mask`);
    const unpacked = packed.stream().pipeThrough(new DecompressionStream("gzip"));
    return decodeMask(await new Response(unpacked).arrayBuffer());
  }

  async #save(what: "mask" | "envelope"): Promise<void> {
    try {
      saveFile(await getFile(`${this.#shown.id}/${what}`), `${fileStem(this.#shown)}-${what}.nii.gz`);
      setText(this.#note, t("case.saved"));
    } catch (problem) {
      setText(this.#note, problemWords(problem));
    }
  }

  async #makeVersion(event: SubmitEvent): Promise<void> {
    event.preventDefault();
    const mask = this.#mask.files?.[0] ?? null;
    const [offset, radius] = [this.#offset.valueAsNumber, this.#radius.valueAsNumber];
    // A mask that is handed in is taken as it is, unless another offset is asked for.
    const hasOffset = Number.isFinite(offset) && (mask === null || offset !== this.#shown.offset_mm);
    const parameters = {
      ...(Number.isFinite(radius) && { closing_radius_mm: String(radius) }),
      ...(hasOffset && { offset_mm: String(offset) }),
    };
    this.#make.disabled = true;
    setText(this.#note, t("version.sending"));
    try {
      const { created, wasThere } = await makeVersion(this.#shown.id, parameters, mask);
      const isItself = created.id === this.#shown.id;
      setText(this.#note, t(isItself ? "version.itself" : wasThere ? "version.was-there" : "version.made"));
      if (!isItself) this.#listener.made(created, wasThere);
    } catch (problem) {
      setText(this.#note, problemWords(problem));
    }
    this.#make.disabled = false;
  }
}
