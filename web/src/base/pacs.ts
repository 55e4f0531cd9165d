// What the server has of a PACS, and the patient of a case, if its configuration lets the page show it.

import { ask, getDicom, Problem } from "./api.ts";
import { t } from "./i18n.ts";
import type { ReadyCase } from "../model/case.ts";

interface PacsView {
  /** To which results can be sent. */
  readonly nodes: readonly string[];
  readonly patient_banner: boolean;
}

/** Without a PACS there is nothing to send to, and no patient to show. */
export async function pacsOf(): Promise<PacsView> {
  try {
    return await ask<PacsView>("v1/pacs");
  } catch (problem) {
    if (problem instanceof Problem && problem.status === 404) return { nodes: [], patient_banner: false };
    throw problem;
  }
}

/** A date of DICOM with dashes. */
export const dateWords = (text = ""): string => text.replace(/^(\d{4})(\d\d)(\d\d).*$/, "$1-$2-$3");

/** Whose head it is, if the page may show that; empty if not, or if the case is not from DICOM. */
export async function patientWords({ id, links }: Pick<ReadyCase, "id" | "links">): Promise<string> {
  if (!links?.dicom || !(await pacsOf()).patient_banner) return "";
  const attributes = await getDicom(id).catch(() => null);
  if (!attributes) return t("pacs.patient-unknown");
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
