"use strict";
// The page of `setid serve`: sends a record, starts a job, shows what it has so far.
const by = (id) => document.getElementById(id);
let file = null, record = null, job = null, shown = 0;
let sent = 0; // tables sent; the answer to an earlier one is dropped

async function ask(path, options = {}) {
  const headers = { "X-Setid": "page", ...(options.headers || {}) };
  let answer;
  try {
    answer = await fetch(path, { ...options, headers });
  } catch {
    throw new Error("the server does not answer: is setid serve still running?");
  }
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error || answer.statusText);
  return found;
}

function complain(error) {
  by("error").textContent = error ? error.message : "";
  by("error").hidden = !error;
}

function clear() {
  job = null; // what is under way for the page so far is not shown any more
  shown = 0;
  for (const id of ["report", "downloads", "state"]) by(id).replaceChildren();
  by("stop").hidden = by("bar").hidden = true;
}

async function send(given) {
  const turn = ++sent;
  if (job) ask(`/jobs/${job}`, { method: "DELETE" }).catch(() => {});
  clear();
  file = given;
  record = null;
  by("form").hidden = true;
  complain(null);
  try {
    const decimal = encodeURIComponent(by("decimal").value);
    const found = await ask(`/records?decimal=${decimal}`, { method: "POST", body: given });
    if (turn !== sent) return;
    record = found.record;
    by("about").textContent = `${given.name}: ${found.samples} samples, ${found.columns.length} columns`;
    for (const [id, chosen] of [["inputs", 0], ["outputs", found.columns.length - 1]]) {
      by(id).replaceChildren(...found.columns.map((name, place) => {
        const wanted = { inputs: "u", outputs: "y" }[id];
        const fits = found.columns.includes(wanted) ? name === wanted : place === chosen;
        return new Option(typeof name === "number" ? `column ${name}` : name, JSON.stringify(name), fits, fits);
      }));
    }
    by("form").hidden = false;
  } catch (error) {
    if (turn !== sent) return;
    by("about").textContent = "";
    complain(error);
  }
}

// Fields that a structure does not have are no part of what is asked.
function fit() {
  const kind = by("structure").value;
  by("nk").disabled = by("offset").disabled = kind !== "TransferFunction";
  by("stable").disabled = kind === "PolynomialNARX";
}

const chosen = (id) => [...by(id).selectedOptions].map((option) => JSON.parse(option.value));
const number = (id) => (by(id).disabled ? 0 : by(id).value === "" ? null : Number(by(id).value));

async function start() {
  if (by("go").disabled) return;
  complain(null);
  clear();
  const given = { record, file: file.name, inputs: chosen("inputs"), outputs: chosen("outputs"), structure: by("structure").value };
  for (const id of ["Ts", "samples", "na", "nb", "nk", "equation", "output", "input", "seconds"]) given[id] = number(id);
  for (const id of ["offset", "stable"]) given[id] = !by(id).disabled && by(id).checked;
  by("go").disabled = true;
  try {
    const headers = { "Content-Type": "application/json" };
    const begun = (await ask("/jobs", { method: "POST", headers, body: JSON.stringify(given) })).job;
    if (given.record === record) job = begun; // no other table was chosen meanwhile
  } catch (error) {
    complain(error);
  } finally {
    by("go").disabled = false;
  }
  if (job) follow(job);
}

async function follow(name) {
  while (name === job) {
    let found;
    try {
      found = await ask(`/jobs/${name}`);
      if (name !== job) return;
    } catch (error) {
      if (name !== job) return;
      by("stop").hidden = by("bar").hidden = true;
      return complain(error);
    }
    show(name, found);
    if (found.state !== "running") return;
    await new Promise((wake) => setTimeout(wake, 400));
  }
}

function show(name, found) {
  if (name !== job) return;
  const running = found.state === "running";
  by("stop").hidden = by("bar").hidden = !running;
  const ends = found.ends ? `, ${found.settled} of ${found.ends} intervals` : "";
  const words = running ? `${found.stage || "starting"}${ends}` : found.status || found.state;
  by("state").textContent = `${words} (${found.seconds} s)`;
  if (found.ends) { by("bar").max = found.ends; by("bar").value = found.settled; } else by("bar").removeAttribute("value");
  if (found.error) complain(new Error(found.error));
  for (const { title, html } of found.sections.slice(shown)) {
    const part = document.createElement("section");
    part.className = "section";
    part.appendChild(document.createElement("h2")).textContent = title;
    part.appendChild(document.createElement("div")).innerHTML = html; // made and escaped by the server
    by("report").appendChild(part);
  }
  shown = Math.max(shown, found.sections.length);
  const links = by("downloads");
  if (found.files.length && !links.childElementCount) links.append("Download: ");
  for (const title of found.files.slice(links.childElementCount)) {
    const link = document.createElement("a");
    link.href = `/jobs/${name}/${title}`;
    link.textContent = title;
    links.append(link, " ");
  }
}

by("file").addEventListener("change", () => by("file").files[0] && send(by("file").files[0]));
by("decimal").addEventListener("change", () => file && send(file));
by("form").addEventListener("submit", (event) => { event.preventDefault(); start(); });
by("structure").addEventListener("change", fit);
by("stop").addEventListener("click", () => {
  const name = job;
  ask(`/jobs/${name}`, { method: "DELETE" }).then((found) => show(name, found), complain);
});
for (const [kind, over] of [["dragover", true], ["dragleave", false], ["drop", false]]) {
  by("drop").addEventListener(kind, (event) => {
    event.preventDefault();
    by("drop").classList.toggle("over", over);
    if (kind === "drop" && event.dataTransfer.files[0]) send(event.dataTransfer.files[0]);
  });
}
