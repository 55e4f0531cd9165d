// The server's interface. The token, if one is asked for, lives in this module's memory alone.

import { sentence } from "./scene.js";

let token = "";
let askForToken = async () => "";

/** An answer that is not a success, in words fit for the page. */
export class Problem extends Error {
  constructor(status, message, retryAfter = 0) {
    super(message);
    this.status = status;
    /** Seconds after which the server would like to be asked again; 0 where it did not say. */
    this.retryAfter = retryAfter;
  }
}

/** `ask(refused)` resolves to the token that the user typed; it is called whenever the server answers 401. */
export function onTokenWanted(ask) {
  // Many requests may be refused at once; the user is asked once.
  let asking = null;
  askForToken = (refused) => (asking ??= ask(refused).finally(() => (asking = null)));
}

const headers = () => (token ? { authorization: `Bearer ${token}` } : {});

/** Waits for another token than the one `sent` where `problem` is a 401; true when it is worth trying again. */
async function tokenEntered(problem, sent) {
  if (problem.status !== 401) return false;
  // Another request may have brought a token in the meantime.
  if (token === sent) token = await askForToken(sent !== "");
  return token !== "";
}

async function send(path, options = {}) {
  for (;;) {
    const sent = token;
    let response;
    try {
      response = await fetch(path, { ...options, headers: { ...options.headers, ...headers() } });
    } catch {
      throw new Problem(0, "The server does not answer.");
    }
    if (response.ok) return response;
    const problem = problemFrom(
      response.status,
      response.headers.get("content-type"),
      await response.text(),
      response.headers.get("retry-after"),
    );
    if (!(await tokenEntered(problem, sent))) throw problem;
  }
}

/** Reads a problem+json body; another body is not shown. */
export function problemFrom(status, contentType, body, retryAfter) {
  let message = "";
  if (contentType?.includes("json")) {
    try {
      const { title, detail } = JSON.parse(body);
      message = detail || title || "";
    } catch {
      // A body that is no JSON says nothing to the user; the status does.
    }
  }
  return new Problem(status, sentence(message || `the server answered with status ${status}`), Number(retryAfter) || 0);
}

/** One page of cases, newest first: `{ cases, next }`, `next` being the cursor of the page after, if any. */
export async function listCases(after) {
  const query = after ? `?${new URLSearchParams({ after })}` : "";
  return (await send(`v1/cases${query}`, { cache: "no-store" })).json();
}

/** One case as it is now. */
export async function getCase(id) {
  return (await send(`v1/cases/${id}`, { cache: "no-store" })).json();
}

/** Deletes a case for good. */
export async function deleteCase(id) {
  await send(`v1/cases/${id}`, { method: "DELETE" });
}

/** A picture of a case; `path` begins with the case's id. */
export async function getPicture(path) {
  return (await send(`v1/cases/${path}`)).blob();
}

/** Uploads a form and resolves to the case; `observe` hears the fraction that is sent (fetch cannot tell that). */
export async function uploadCase(form, observe) {
  for (;;) {
    const sent = token;
    try {
      return await postForm("v1/cases", form, observe);
    } catch (error) {
      if (!(await tokenEntered(error, sent))) throw error;
    }
  }
}

function postForm(path, form, observe) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    for (const [name, value] of Object.entries(headers())) request.setRequestHeader(name, value);
    request.upload.onprogress = (event) => event.lengthComputable && observe(event.loaded / event.total);
    request.onerror = () => reject(new Problem(0, "The upload was cut off."));
    request.onload = () => {
      if (request.status >= 200 && request.status < 300) return resolve(JSON.parse(request.responseText));
      const header = (name) => request.getResponseHeader(name);
      reject(problemFrom(request.status, header("content-type"), request.responseText, header("retry-after")));
    };
    request.send(form);
  });
}
