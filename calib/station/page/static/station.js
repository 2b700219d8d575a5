// The operator's page: connection, and what belongs to the section that is shown.
import { MapView } from "./map.js";
import { drawSight } from "./sight.js";

const SILENT_MS = 2000; // without a frame for so long, what is shown is old
const AGAIN_MS = 1000; // before a lost connection is tried again

const state = { frame: null, scene: null, heard: performance.now() };
let view = null;

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.scene) state.scene = message.scene;
    state.frame = message.frame;
    if (message.frame.age_s !== null) state.heard = performance.now() - 1000 * message.frame.age_s;
    render();
  };
  socket.onclose = () => setTimeout(connect, AGAIN_MS);
}

function render() {
  const map = document.getElementById("map");
  if (map && !document.querySelector("[data-recording]")) {
    view = view ?? new MapView(map, document.querySelectorAll(".tools button"));
    view.show(state.scene, state.frame);
    showTargets(state.frame.targets);
  }
  for (const canvas of document.querySelectorAll("canvas.view")) {
    const camera = canvas.dataset.camera;
    drawSight(canvas, state.frame.sights[camera], state.frame.previews[camera], camera);
  }
}

const HEAD = ["target", "state", "east", "north", "height", "speed", "sigma", "cameras"];

export function showTargets(targets) {
  const place = document.getElementById("targets");
  if (!place) return;
  const rows = targets.map((t) => {
    const speed = Math.hypot(...t.velocity);
    const sigma = Math.sqrt(t.spread[0] + t.spread[3] + t.spread[5]);
    return [t.id, t.state, ...t.at.map((v) => `${v.toFixed(1)} m`), `${speed.toFixed(1)} m/s`, `${sigma.toFixed(2)} m`,
      t.cameras.join(" ") + (t.verified ? "" : t.cameras.length < 3 ? " (range unverified)" : " (unverified)")];
  });
  const table = document.createElement("table");
  const head = table.createTHead().insertRow();
  for (const word of HEAD) head.appendChild(Object.assign(document.createElement("th"), { textContent: word }));
  const body = table.createTBody();
  for (const cells of rows) {
    const row = body.insertRow();
    row.dataset.target = cells[0];
    for (const cell of cells) row.insertCell().textContent = cell;
  }
  const none = Object.assign(document.createElement("p"), { textContent: "No target now." });
  place.replaceChildren(rows.length ? table : none);
}

function watchSilence() {
  const lost = document.getElementById("lost");
  if (!lost) return;
  const silent = performance.now() - state.heard;
  lost.hidden = silent < SILENT_MS;
  if (!lost.hidden) lost.textContent = `No word from the station for ${Math.round(silent / 1000)} s: what you see is old.`;
}

async function openPast(place) {
  const name = encodeURIComponent(place.dataset.recording);
  const slider = document.getElementById("scrub");
  const past = new MapView(document.getElementById("map"), []);
  const answer = await fetch(`/past/${name}/length`);
  if (!answer.ok) {
    document.getElementById("when").textContent = await answer.text();
    return;
  }
  slider.max = (await answer.json()).seconds;
  let wanted = null;
  const look = async () => {
    const at = slider.value;
    if (wanted === at) return;
    wanted = at;
    const then = await (await fetch(`/past/${name}?at_s=${at}`)).json();
    if (wanted !== at) return; // moved on meanwhile
    document.getElementById("when").textContent =
      `${Number(at).toFixed(1)} s: ${new Date(then.t_unix_ns / 1e6).toISOString().replace("T", " ")}`;
    past.show({ cameras: then.cameras, trails: {}, coverage: [], cell_m: 10, origin: null }, { targets: then.targets, rays: [] });
    showTargets(then.targets);
  };
  slider.addEventListener("input", look);
  await look();
}

function start() {
  const past = document.querySelector("[data-recording]");
  if (past && !past.dataset.open) {
    past.dataset.open = "yes";
    openPast(past);
  }
  if (document.getElementById("lost")) {
    connect();
    setInterval(watchSilence, 250);
  } else {
    setTimeout(start, 50); // the library builds the page after this script has run
  }
}

start();
