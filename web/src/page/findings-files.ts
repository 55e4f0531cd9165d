// Findings as files: the report of a reading, tables and DICOM objects that are saved, and lists that are added.

import { getFile, postForFile } from "../base/api.ts";
import { h, quiet, setText, tell } from "../base/dom.ts";
import { number, spoken, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Finding, type Merged, joined, readFindings } from "../model/findings.ts";
import { fileStem } from "./export.ts";
import { button, choice, fileButton, fileInput, row, ticked } from "./fields.ts";
import type { FindingsSync } from "./findings-sync.ts";
import { saveFile } from "./picture-file.ts";

export interface FindingFilesHost {
  readonly shown: ReadyCase;
  readonly sync: FindingsSync;
  readonly status: HTMLElement;
  /** Findings of a file have been added to those before. */
  added(before: readonly Finding[], after: readonly Finding[]): void;
  /** So many findings are in the file and in the list, and say something else: both are kept. */
  doubled(count: number): void;
}

/** As what findings can be saved; those of DICOM if the case was made of it. */
const FORMATS = ["csv", "json", "labels", "report", "segments"] as const;
type Format = (typeof FORMATS)[number];

const DICOM = "application/dicom";

/** Whether a file has the name of one that was saved from another case, and not from a version of this one. */
export function isOfOther(name: string, { id, previous, next = [] }: ReadyCase): boolean {
  const from = /^isocortex-([0-9a-f]{8})-/.exec(name)?.[1];
  return from !== undefined && ![id, previous, ...next].some((one) => one?.startsWith(from));
}

export function findingFiles({ shown, sync, status, added, doubled }: FindingFilesHost): readonly HTMLElement[] {
  const path = `${shown.id}/findings`;
  const results = (what: string): Promise<Blob> => postForFile(`v1/cases/${shown.id}/dicom-results`, { what });
  const files: Readonly<Record<Format, readonly [string, () => Promise<Blob>]>> = {
    csv: ["findings.csv", () => getFile(path, "text/csv")],
    json: ["findings.json", () => getFile(path, "application/json")],
    labels: ["findings.nii.gz", () => getFile(path, "application/gzip")],
    report: ["findings.dcm", () => results("findings")],
    segments: ["finding-segments.dcm", () => results("finding-segments")],
  };

  /** Saves what the server makes of the findings, once it has them. */
  const save = async (name: string, make: () => Promise<Blob>): Promise<void> => {
    tell(status, t("export.working"));
    try {
      // A file without the last sentence would look as if it were complete: then there is none.
      await sync.flush();
    } catch (problem) {
      return tell(status, t("findings.unsaved", { why: problemWords(problem) }));
    }
    try {
      saveFile(await make(), `${fileStem(shown)}-${name}`);
      setText(status, t("findings.saved"));
    } catch (problem) {
      tell(status, problemWords(problem));
    }
  };

  const add = async (file: File | undefined): Promise<void> => {
    if (!file) return;
    tell(status, t("export.working"));
    const before = sync.list;
    let all: Merged = { list: before, doubled: 0 };
    try {
      if ((await file.slice(128, 132).text()) === "DICM")
        await sync.take(file, DICOM, (given) => (all = joined(before, given)).list);
      else {
        const given = readFindings(await file.text());
        if (!given) return tell(status, t("findings.unreadable"));
        // All of it goes to the server, which takes all or nothing.
        all = joined(before, given);
        const body = JSON.stringify({ findings: all.list });
        await sync.take(body, "application/json", (stored) => stored);
      }
    } catch (problem) {
      return tell(status, problemWords(problem));
    }
    // What others have added meanwhile is not taken back with the file.
    const known = new Set(before.map(({ id }) => id));
    const ids = new Set(all.list.map(({ id }) => id).filter((id) => !known.has(id)));
    const taken = sync.list.filter(({ id }) => ids.has(id));
    added(before, [...before, ...taken]);
    if (all.doubled > 0) doubled(all.doubled);
    const count = number(taken.length);
    tell(status, t(isOfOther(file.name, shown) ? "findings.added-of-other" : "findings.added", { count }));
  };

  const isOfPatient = shown.links?.dicom !== undefined;
  const named = h("input", { type: "checkbox", id: "report-patient" });
  const saveReport = (ending: "html" | "pdf", kind: string): void => {
    const query = new URLSearchParams({ language: spoken(), ...(named.checked && { patient: "true" }) });
    void save(`report.${ending}`, () => getFile(`${shown.id}/report?${query}`, kind));
  };
  const report = button(t("findings.report"), () => saveReport("html", "text/html"));
  const pdf = button(t("findings.pdf"), () => saveReport("pdf", "application/pdf"), { title: t("findings.pdf-title") });
  const offered = FORMATS.filter((format) => isOfPatient || (format !== "report" && format !== "segments"));
  const format = choice("findings-format", t("findings.format"), offered, (one) => t(`findings.as-${one}`));
  const table = button(t("findings.save"), () => void save(...files[offered[format.selectedIndex] ?? "csv"]));
  const input = fileInput(
    "findings-file",
    ([file]) => {
      void add(file);
      // The same file may be chosen again.
      input.value = "";
    },
    { accept: isOfPatient ? ".json,.dcm" : ".json" },
  );
  const why = isOfPatient ? null : quiet(t("findings.no-dicom"));
  const words = t("findings.add-file");
  const open = h("label", { class: "file" }, h("span", { class: "visually-hidden" }, words), input, fileButton(words));
  return [
    row(report, pdf, isOfPatient ? ticked(named, t("findings.patient")) : null),
    row(format, table),
    why,
    row(open),
  ].filter((one) => one !== null);
}
