// The form that adds a case.

import { uploadCase } from "./api.js";

/** Sends the form when asked to; `onCreated(case)` hears of the new case. */
export function setUpUpload(onCreated) {
  const form = document.getElementById("upload");
  const bar = document.getElementById("upload-progress");
  const note = document.getElementById("upload-note");
  const button = form.querySelector("button[type=submit]");

  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const say = (words, failed = false) => {
      note.textContent = words;
      note.classList.toggle("error", failed);
    };
    button.disabled = true;
    bar.hidden = false;
    bar.value = 0;
    say("Sending …");
    try {
      const created = await uploadCase(bodyOf(form), (fraction) => (bar.value = fraction));
      say("");
      form.reset();
      form.closest("details").open = false;
      await onCreated(created);
    } catch (problem) {
      say(problem.message, true);
    } finally {
      button.disabled = false;
      bar.hidden = true;
    }
  });
}

/** The multipart body. The files go under fixed names, for a file's own name may hold the patient's. */
function bodyOf(form) {
  const fields = new FormData(form);
  const parameters = { closing_radius_mm: Number(fields.get("closing_radius_mm")) };
  const name = fields.get("name").trim();
  if (name) parameters.name = name;
  const body = new FormData();
  body.append("parameters", new Blob([JSON.stringify(parameters)], { type: "application/json" }));
  for (const part of ["volume", "mask"]) {
    const file = fields.get(part);
    if (file?.size) body.append(part, file, file.name.endsWith(".gz") ? `${part}.nii.gz` : `${part}.nii`);
  }
  return body;
}
