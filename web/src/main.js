// The page: the list of cases on one side, the chosen one on the other. The address's hash holds the chosen case's id.

import * as api from "./api.js";
import { CaseList } from "./cases.js";
import { caseStatus, caseTitle } from "./scene.js";
import { setUpUpload } from "./upload.js";
import { Viewer } from "./viewer.js";

const element = (id) => document.getElementById(id);

const viewer = new Viewer();
const list = new CaseList({ onChange: showChosen });
let chosen = null;

api.onTokenWanted(async (refused) => {
  element("token-text").textContent = refused
    ? "The server did not accept that token. Try once more."
    : "It is kept until this page is closed, and nowhere else.";
  element("token").value = "";
  const dialog = element("ask-token");
  dialog.showModal();
  await new Promise((resolve) => dialog.addEventListener("close", resolve, { once: true }));
  return element("token").value.trim();
});

setUpUpload(async (created) => {
  await list.refresh();
  location.hash = created.id;
});

/** Shows the case that the hash names; the first ready one where it names none. */
async function showChosen() {
  let id = location.hash.slice(1);
  if (!/^[0-9a-f]{32}$/.test(id)) id = list.cases.find((one) => one.state === "ready")?.id;
  list.mark(id);
  chosen = list.cases.find((one) => one.id === id) ?? (id ? await askFor(id) : null);
  element("case-title").textContent = chosen ? caseTitle(chosen) : "No case chosen";
  element("delete").hidden = !chosen;
  const ready = chosen?.state === "ready";
  element("case-note").textContent = chosen
    ? ready ? "" : caseStatus(chosen)
    : "Choose a case from the list, or add one.";
  element("case-note").classList.toggle("error", chosen?.state === "failed");
  element("viewer").hidden = !ready;
  viewer.show(ready ? chosen : null);
}

/** A case that the list does not hold (yet): null where there is none. */
async function askFor(id) {
  try {
    return await api.getCase(id);
  } catch (problem) {
    list.note(problem.status === 404 ? "That case does not exist (any more)." : problem.message);
    return null;
  }
}

element("delete").addEventListener("click", async () => {
  const doomed = chosen;
  element("confirm-text").textContent = `“${caseTitle(doomed)}” and all that was computed of it go for good.`;
  const dialog = element("confirm-delete");
  dialog.returnValue = "keep";
  dialog.showModal();
  await new Promise((resolve) => dialog.addEventListener("close", resolve, { once: true }));
  if (dialog.returnValue !== "delete") return;
  try {
    await api.deleteCase(doomed.id);
    history.replaceState(null, "", location.pathname);
    await list.refresh();
  } catch (problem) {
    list.note(problem.message);
  }
});

window.addEventListener("hashchange", showChosen);
list.start();
