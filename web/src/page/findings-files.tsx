// Findings as files: the report of a reading, tables and DICOM objects that are saved, and lists that are added.

import { useState } from "preact/hooks";

import { getFile, postForFile } from "../base/api.ts";
import { number, spoken, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Finding, joined, readFindings } from "../model/findings.ts";
import type { Store } from "../store/store.ts";
import { findingsStl, saveWithFindings } from "./export.ts";
import { Button, Choice, FileInput, type OfStore, Quiet, Row, Ticked, Writing } from "./fields.tsx";
import { takeOver } from "./take-over.tsx";

/** As what findings can be saved; those of DICOM if the case was made of it. */
const FORMATS = ["csv", "json", "labels", "stl", "report", "segments"] as const;
type Format = (typeof FORMATS)[number];

const DICOM = "application/dicom";

/** Whether a file has the name of one that was saved from another case, and not from a version of this one. */
export function isOfOther(name: string, { id, previous, next = [] }: ReadyCase): boolean {
  const from = /^isocortex-([0-9a-f]{8})-/.exec(name)?.[1];
  return from !== undefined && ![id, previous, ...next].some((one) => one?.startsWith(from));
}

/** How each kind of file is called, and made by the server. */
function filesOf({ shown }: Store): Readonly<Record<Format, readonly [string, () => Promise<Blob>]>> {
  const path = `${shown.id}/findings`;
  const results = (what: string): Promise<Blob> => postForFile(`v1/cases/${shown.id}/dicom-results`, { what });
  return {
    csv: ["findings.csv", () => getFile(path, "text/csv")],
    json: ["findings.json", () => getFile(path, "application/json")],
    labels: ["findings.nii.gz", () => getFile(path, "application/gzip")],
    stl: ["findings.stl", () => findingsStl(shown)],
    report: ["findings.dcm", () => results("findings")],
    segments: ["finding-segments.dcm", () => results("finding-segments")],
  };
}

/** Saves what the server makes of the findings. */
async function save(store: Store, name: string, make: () => Promise<Blob>): Promise<void> {
  store.findings.status.value = t("export.working");
  store.findings.status.value = await saveWithFindings(store, `-${name}`, make);
}

/** Adds the findings of a file; all of it goes to the server, which takes all or nothing. */
async function add({ findings, shown }: Store, file: File): Promise<void> {
  const { status, sync } = findings;
  status.value = t("export.working");
  let before = sync.value.peek();
  let all: ReturnType<typeof joined> = { list: before, doubled: 0 };
  const join = (now: readonly Finding[], given: readonly Finding[]): readonly Finding[] => {
    before = now;
    all = joined(now, given);
    return all.list;
  };
  try {
    if ((await file.slice(128, 132).text()) === "DICM") await sync.take(() => file, DICOM, join);
    else {
      const given = readFindings(await file.text());
      if (!given) return void (status.value = t("findings.unreadable"));
      const body = (now: readonly Finding[]): string => JSON.stringify({ findings: join(now, given) });
      await sync.take(body, "application/json", (_now, stored) => stored);
    }
  } catch (problem) {
    return void (status.value = problemWords(problem));
  }
  // What others have added meanwhile is not taken back with the file.
  const known = new Set(before.map(({ id }) => id));
  const ids = new Set(all.list.map(({ id }) => id));
  const taken = sync.value.peek().filter(({ id }) => ids.has(id) && !known.has(id));
  findings.did(before, [...before.filter(({ id }) => ids.has(id)), ...taken]);
  if (all.doubled > 0) findings.doubled.value = t("findings.otherwise", { count: number(all.doubled) });
  const count = number(taken.length);
  status.value = t(isOfOther(file.name, shown) ? "findings.added-of-other" : "findings.added", { count });
}

export function FindingFiles({ store }: OfStore) {
  const { shown } = store;
  const isOfPatient = shown.links?.dicom !== undefined;
  const offered = FORMATS.filter((one) => isOfPatient || (one !== "report" && one !== "segments"));
  const [format, setFormat] = useState<Format>("csv");
  const [isNamed, setNamed] = useState(false);
  const report = (ending: "html" | "pdf", kind: string): void => {
    void save(store, `report.${ending}`, async () => {
      const reading = await store.reading.reported();
      const asked = { language: spoken(), ...(isNamed && { patient: "true" }), ...(reading && { reading }) };
      return getFile(`${shown.id}/report?${new URLSearchParams(asked)}`, kind);
    });
  };
  return (
    <>
      <Row>
        <Button onClick={() => report("html", "text/html")}>{t("findings.report")}</Button>
        <Button title={t("findings.pdf-title")} onClick={() => report("pdf", "application/pdf")}>
          {t("findings.pdf")}
        </Button>
        {isOfPatient && (
          <Ticked id="report-patient" words={t("findings.patient")} checked={isNamed} onTick={setNamed} />
        )}
      </Row>
      <details>
        <summary>{t("findings.files")}</summary>
        <div class="group-part">
          <Row>
            <Choice
              id="findings-format"
              label={t("findings.format")}
              values={offered}
              value={format}
              words={(one) => t(`findings.as-${one}`)}
              onChoose={(one) => setFormat(one)}
            />
            <Button onClick={() => void save(store, ...filesOf(store)[format])}>{t("findings.save")}</Button>
          </Row>
          {!isOfPatient && <Quiet>{t("findings.no-dicom")}</Quiet>}
          <Row>
            <Writing>
              <FileInput
                id="findings-file"
                words={t("findings.add-file")}
                accept={isOfPatient ? ".json,.dcm" : ".json"}
                onFiles={([file]) => {
                  if (file) void add(store, file);
                }}
              />
              <Button onClick={() => void takeOver(store)}>{t("take-over.open")}</Button>
            </Writing>
          </Row>
        </div>
      </details>
    </>
  );
}
