// Opens the case of the study that the address names, or says how far it is.
"use strict";

// Before anything else: the identifiers leave the address and the history of the browser.
const query = location.search;
history.replaceState(null, "", location.pathname);

const LOOK_AGAIN_MS = 2000;
const message = document.getElementById("message");
const actions = document.getElementById("actions");
const tokenForm = document.getElementById("token-form");
const tokenInput = document.getElementById("token");
let token = "";

function say(text) {
  if (message.textContent !== text) message.textContent = text;
}

/** An answer as JSON, to a POST if there is a body; asks for the token when the server wants one. */
async function ask(address, body) {
  for (;;) {
    const headers = token ? { authorization: `Bearer ${token}` } : {};
    const method = body ? "POST" : "GET";
    const answer = await fetch(address, { method, headers, body: body && JSON.stringify(body), cache: "no-store" });
    const value = await answer.json().catch(() => ({}));
    if (answer.ok) return value;
    if (answer.status !== 401) throw new Error(value.detail || `The server answered with status ${answer.status}.`);
    token = await askForToken(token !== "");
  }
}

function askForToken(refused) {
  say(refused ? "The server does not accept this token." : "This server requires a token.");
  tokenForm.hidden = false;
  tokenInput.value = "";
  tokenInput.focus();
  return new Promise((resolve) => {
    tokenForm.onsubmit = (event) => {
      event.preventDefault();
      tokenForm.hidden = true;
      resolve(tokenInput.value);
    };
  });
}

/** Buttons that fetch the series from one of the nodes. */
function offer(found) {
  const buttons = found.nodes.map((node) => {
    const button = document.createElement("button");
    button.textContent = `Fetch it from ${node}`;
    button.onclick = () => {
      actions.replaceChildren();
      void run(() => fetchFrom(node, found));
    };
    return button;
  });
  actions.replaceChildren(...buttons);
}

/** A date of DICOM as people write it. */
const day = (text = "") => text.replace(/^(\d{4})(\d\d)(\d\d).*$/, "$1-$2-$3");

/** What distinguishes a case from the others, without naming the patient unless the server does. */
function described({ patient, study_date, acquired, series, is_derived, has_contrast, voxel_mm, case: id, state }) {
  const size = voxel_mm?.map((side) => Number(side.toFixed(2))).join(" × ");
  const parts = [
    patient,
    day(study_date || acquired),
    series && `series ${series}`,
    is_derived && "derived",
    has_contrast && "contrast agent",
    size && `${size} mm`,
    state !== "ready" && state.replace("_", " "),
    id.slice(0, 8),
  ];
  return parts.filter(Boolean).join(" · ");
}

/** Opens a case. The page takes the token from there at once, and asks nobody a second time. */
function open(id) {
  if (token) sessionStorage.token = token;
  location.replace(`./#${id}`);
}

/** A list of buttons that open the cases. */
function choose(candidates) {
  const buttons = candidates.map((candidate) => {
    const button = document.createElement("button");
    button.textContent = described(candidate);
    button.onclick = () => open(candidate.case);
    return button;
  });
  actions.replaceChildren(...buttons);
  buttons[0]?.focus();
}

async function fetchFrom(node, found) {
  say("The series is being fetched …");
  const { study, series } = found;
  let retrieval = await ask("v1/retrievals", { node, study, series });
  while (retrieval.state === "queued" || retrieval.state === "running") {
    await wait();
    retrieval = await ask(`v1/retrievals/${retrieval.id}`);
  }
  if (retrieval.state === "failed") throw new Error(`The series could not be fetched: ${retrieval.reason.detail}.`);
  await follow();
}

const wait = () => new Promise((resolve) => setTimeout(resolve, LOOK_AGAIN_MS));

/** Looks again and again until there is something to open, or nothing will come. */
async function follow() {
  for (;;) {
    const found = await ask("v1/launch", { query });
    const reason = found.reason ? ` ${found.reason.detail}.` : "";
    switch (found.state) {
      case "ready":
        if (found.ignored.length === 0) return open(found.case);
        // Perhaps they should have narrowed the search.
        say(`The address has unknown keys, which had no effect: ${found.ignored.join(", ")}. Check what you open.`);
        return choose(found.candidates);
      case "choice":
        say("The address fits several studies or patients. Choose one.");
        return choose(found.candidates);
      case "mismatch":
        say("There is such a study here, but not with the patient or the accession number that the address names.");
        return;
      case "preparing":
        say("The case is being prepared. It opens as soon as it is ready.");
        break;
      case "receiving":
        say("The images are being received. The case opens as soon as it is ready.");
        break;
      case "failed":
        say(`The case could not be prepared.${reason}`);
        return;
      case "nothing":
        say(`The study has no series that can be shown.${reason}`);
        return;
      default:
        say("This study is not here.");
        offer(found);
        return;
    }
    await wait();
  }
}

async function run(step) {
  try {
    await step();
  } catch (error) {
    say(error instanceof TypeError ? "The server cannot be reached." : error.message);
  }
}

void run(follow);
