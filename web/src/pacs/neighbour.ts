// What a case from DICOM has beside its pictures: the patient, if the server's configuration lets the page show it, and
// results that are sent to a node of the PACS.

import { Problem, getDicom, send } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Marks, type Render, resultsSection } from "./results.ts";

/** What the server has of a PACS. */
interface PacsView {
  readonly nodes: readonly string[];
  readonly patient_banner: boolean;
}

/** Adds to the viewer of a case and to the panel beside it what there is to add; without a PACS, nothing. */
export async function meetNeighbour(
  id: string,
  viewer: HTMLElement,
  render: Render,
  marks: () => Marks,
): Promise<void> {
  const { nodes, patient_banner } = await pacsOf();
  if (patient_banner) await showPatient(id, viewer).catch(() => showBanner(viewer, t("pacs.patient-unknown")));
  const panel = viewer.closest(".page")?.querySelector(".panel");
  if (nodes.length > 0) panel?.append(resultsSection(id, nodes, render, marks));
}

async function pacsOf(): Promise<PacsView> {
  try {
    return (await (await send("v1/pacs", { cache: "no-store" })).json()) as PacsView;
  } catch (problem) {
    if (problem instanceof Problem && problem.status === 404) return { nodes: [], patient_banner: false };
    throw problem;
  }
}

/** A date of DICOM with dashes. */
export const dateWords = (text = ""): string => text.replace(/^(\d{4})(\d\d)(\d\d).*$/, "$1-$2-$3");

/** Whose head it is, if the page may show that; empty if not, or if the case is not from DICOM. */
export async function patientWords({ id, links }: Pick<ReadyCase, "id" | "links">): Promise<string> {
  return links?.dicom && (await pacsOf()).patient_banner ? identityWords(id) : "";
}

async function showPatient(id: string, viewer: HTMLElement): Promise<void> {
  const text = await identityWords(id);
  if (text) showBanner(viewer, text);
}

async function identityWords(id: string): Promise<string> {
  const attributes = await getDicom(id);
  const { PatientName, PatientID, IssuerOfPatientID, PatientBirthDate, PatientSex, StudyDate } = attributes;
  // Of a name with several spellings the first; its components have carets between them.
  const name = PatientName?.split("=")[0]?.replace("^", ", ").replaceAll("^", " ").trim();
  const series = [attributes.SeriesNumber, attributes.SeriesDescription].filter(Boolean).join(" ");
  const parts = [
    name,
    // Two hospitals may have given one id to two patients.
    [PatientID, IssuerOfPatientID && `(${IssuerOfPatientID})`].filter(Boolean).join(" "),
    PatientBirthDate && `* ${dateWords(PatientBirthDate)}`,
    PatientSex,
    StudyDate && t("pacs.study", { date: dateWords(StudyDate) }),
    series && t("pacs.series", { series }),
  ];
  return parts.filter(Boolean).join(" · ");
}

function showBanner(viewer: HTMLElement, text: string): void {
  viewer.prepend(h("p", { class: "patient-banner", "aria-label": t("pacs.patient") }, text));
}
