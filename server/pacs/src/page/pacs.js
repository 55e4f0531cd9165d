// What a case from DICOM has beside its pictures: the patient, if the server's configuration lets the page show it, and
// a dialog that sends results to a node of the PACS. The page imports this script for such cases.

const WORDS = {
  en: {
    title: "PACS",
    text: "Sends a result to the patient's study as a DICOM object. Sending the same again adds nothing.",
    open: "Send a result …",
    heading: "Send a result",
    what: "Result",
    node: "To",
    view: "This picture",
    sheet: "Contact sheet",
    turn: "A full turn",
    depths: "Through the depths",
    envelope: "Envelope, as a segmentation",
    mask: "Brain mask, as a segmentation",
    noPicture: "A segmentation has no preview.",
    drawing: "Drawing …",
    preview: "What will be sent",
    send: "Send",
    save: "Save as a file",
    close: "Close",
    saved: "Saved.",
    queued: (node) => `Waiting to be sent to ${node} …`,
    running: (node) => `Being sent to ${node} …`,
    again: (node, count) => `${node} does not answer; tried ${count} times …`,
    done: (node) => `${node} has it.`,
    failed: (reason) => `It could not be sent: ${reason}`,
    patient: "Patient",
    study: "study of",
    series: "series",
  },
  "pt-BR": {
    title: "PACS",
    text: "Envia um resultado ao estudo do paciente como objeto DICOM. Enviar o mesmo de novo não acrescenta nada.",
    open: "Enviar um resultado …",
    heading: "Enviar um resultado",
    what: "Resultado",
    node: "Para",
    view: "Esta imagem",
    sheet: "Folha de contato",
    turn: "Uma volta completa",
    depths: "Através das profundidades",
    envelope: "Envelope, como segmentação",
    mask: "Máscara do cérebro, como segmentação",
    noPicture: "Uma segmentação não tem prévia.",
    drawing: "Desenhando …",
    preview: "O que será enviado",
    send: "Enviar",
    save: "Salvar como arquivo",
    close: "Fechar",
    saved: "Salvo.",
    queued: (node) => `Esperando para ser enviado a ${node} …`,
    running: (node) => `Sendo enviado a ${node} …`,
    again: (node, count) => `${node} não responde; ${count} tentativas …`,
    done: (node) => `${node} o recebeu.`,
    failed: (reason) => `Não foi possível enviá-lo: ${reason}`,
    patient: "Paciente",
    study: "estudo de",
    series: "série",
  },
};
const KINDS = ["view", "sheet", "turn", "depths", "envelope", "mask"];
const LOOK_AGAIN_MS = 500;
const PIXELS = 512;
/** Depths of a way through them, in mm. */
const WAY_MM = [2, 24];

/**
 * Adds to a case what there is to add. `host` has the case's `id`; `h`, which makes elements; `send`, which fetches with the
 * token and throws what is no success; `render`, the picture on the screen in so many pixels, as `render` of the interface;
 * and the `viewer`, an element beside which its panel is, as long as the case is open.
 */
export async function attach(host) {
  const words = WORDS[document.documentElement.lang] ?? WORDS.en;
  const pacs = await (await host.send("v1/pacs", { cache: "no-store" })).json();
  if (pacs.patient_banner) await showPatient(host, words);
  const panel = host.viewer.closest(".page")?.querySelector(".panel");
  if (pacs.nodes.length > 0) panel?.append(section(host, words, pacs.nodes));
}

// -- The patient

const date = (text = "") => text.replace(/^(\d{4})(\d\d)(\d\d)$/, "$1-$2-$3");

async function showPatient({ id, h, send, viewer }, words) {
  const { attributes } = await (await send(`v1/cases/${id}/dicom`, { cache: "no-store" })).json();
  // Of a name with several spellings the first; its components have carets between them.
  const name = attributes.PatientName?.split("=")[0].replace("^", ", ").replaceAll("^", " ").trim();
  const { PatientID, PatientBirthDate, PatientSex, StudyDate, SeriesNumber, SeriesDescription } = attributes;
  const series = [SeriesNumber, SeriesDescription].filter(Boolean).join(" ");
  const parts = [
    name,
    PatientID,
    PatientBirthDate && `* ${date(PatientBirthDate)}`,
    PatientSex,
    StudyDate && `${words.study} ${date(StudyDate)}`,
    series && `${words.series} ${series}`,
  ];
  const text = parts.filter(Boolean).join(" · ");
  if (text) viewer.prepend(h("p", { class: "patient-banner", "aria-label": words.patient }, text));
}

/** A reason of the server as a sentence. */
const sentence = (text) => `${text.slice(0, 1).toUpperCase()}${text.slice(1)}${/[.!?…]$/.test(text) ? "" : "."}`;

// -- Results

function section({ h, ...host }, words, nodes) {
  const open = h("button", { click: () => showDialog({ h, ...host }, words, nodes) }, words.open);
  const body = h("div", { class: "group-body" }, h("p", { class: "quiet" }, words.text), h("div", { class: "row" }, open));
  return h("details", { class: "group pacs" }, h("summary", {}, words.title), body);
}

/** The body of a request for a result of a kind. */
function bodyOf(kind, render) {
  switch (kind) {
    case "view":
      return { what: "view", render };
    case "sheet": {
      // Each cell has a direction of its own, and shows the whole head.
      const { orientation, view, zoom, pan, depth_mm, slab_mm, ...look } = render;
      return { what: "sheet", render: { ...look, width: PIXELS / 2, height: PIXELS / 2 }, sheet: {} };
    }
    case "turn":
      return { what: "cine", render, cine: {} };
    case "depths": {
      const { depth_mm, slab_mm, ...look } = render;
      return { what: "cine", render: look, cine: { depths_mm: WAY_MM } };
    }
    default:
      return { what: kind };
  }
}

function showDialog({ id, h, send, render }, words, nodes) {
  const option = (value, text) => h("option", { value }, text);
  const kind = h("select", { id: "result-kind", change: () => void preview() }, ...KINDS.map((one) => option(one, words[one])));
  const node = h("select", { id: "result-node" }, ...nodes.map((one) => option(one, one)));
  const place = h("div", { class: "server-shot" });
  const said = h("p", { class: "quiet", role: "status", id: "result-said" });
  const sendButton = h("button", { class: "primary", click: () => void work(() => sent(node.value)) }, words.send);
  const saveButton = h("button", { click: () => void work(saved) }, words.save);
  const dialog = h(
    "dialog",
    { class: "dialog server-picture result", "aria-labelledby": "result-title" },
    h(
      "form",
      { method: "dialog" },
      h("h2", { id: "result-title" }, words.heading),
      h("label", {}, words.what, kind),
      h("label", {}, words.node, node),
      place,
      said,
      h("div", { class: "row end" }, h("button", { type: "submit" }, words.close), saveButton, sendButton),
    ),
  );

  const isPicture = () => kind.value !== "envelope" && kind.value !== "mask";
  const ask = (more, headers = {}) => {
    const body = JSON.stringify({ ...bodyOf(kind.value, render(PIXELS)), ...more });
    return send(`v1/cases/${id}/dicom-results`, { method: "POST", body, headers });
  };

  /** Draws the first picture of what is chosen, unless something else has been chosen by then. */
  async function preview() {
    const chosen = kind.value;
    dialog.dataset.preview = "";
    said.textContent = "";
    if (!isPicture()) return place.replaceChildren(h("p", { class: "quiet" }, words.noPicture));
    place.replaceChildren(h("p", { class: "quiet" }, words.drawing));
    try {
      const png = await (await ask({}, { accept: "image/png" })).blob();
      if (chosen !== kind.value) return;
      const address = URL.createObjectURL(png);
      const image = h("img", { src: address, alt: words.preview, load: () => URL.revokeObjectURL(address) });
      await image.decode();
      place.replaceChildren(image);
      dialog.dataset.preview = chosen;
    } catch (problem) {
      if (chosen === kind.value) place.replaceChildren(h("p", { class: "bad" }, sentence(problem.message)));
    }
  }

  /** Does something with the result; nothing else can be asked for meanwhile. */
  async function work(step) {
    const controls = [kind, node, sendButton, saveButton];
    for (const one of controls) one.disabled = true;
    try {
      await step();
    } catch (problem) {
      said.textContent = sentence(problem.message);
    }
    for (const one of controls) one.disabled = false;
  }

  async function saved() {
    said.textContent = words.drawing;
    const address = URL.createObjectURL(await (await ask({})).blob());
    h("a", { href: address, download: `isocortex-${id.slice(0, 8)}-${kind.value}.dcm` }).click();
    // The browser reads it after this turn.
    setTimeout(() => URL.revokeObjectURL(address), 60_000);
    said.textContent = words.saved;
  }

  async function sent(to) {
    said.textContent = words.drawing;
    let result = await (await ask({ node: to })).json();
    while (dialog.isConnected && (result.state === "queued" || result.state === "running")) {
      const isTried = result.state === "queued" && result.attempts > 0;
      said.textContent = isTried ? words.again(to, result.attempts) : words[result.state](to);
      await new Promise((resolve) => setTimeout(resolve, LOOK_AGAIN_MS));
      result = await (await send(`v1/dicom-results/${result.id}`, { cache: "no-store" })).json();
    }
    said.textContent = result.state === "failed" ? words.failed(result.reason?.detail ?? "") : words.done(to);
  }

  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  void preview();
}
