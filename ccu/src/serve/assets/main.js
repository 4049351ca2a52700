// The page: reads the stream for as long as it lives, and hands on what comes.

import { Axes } from "./axes.js";
import { byId, write } from "./dom.js";
import { Frames } from "./frames.js";
import { Orders } from "./orders.js";
import { Digital, Events, showFacts } from "./panel.js";
import { readColours } from "./plot.js";
import { authorization, complaint, events as eventsOf, keepToken, takeToken } from "./stream.js";

/** After this much silence of a set that is up, something is wrong; in milliseconds. */
const SILENCE = 3000;

const axes = new Axes();
const orders = new Orders();
const digital = new Digital((order, words) => orders.give(order, words));
const events = new Events();
const frames = new Frames(() => connection?.abort());

let connection = null;
let set = null;
let picture = null;
let heard = 0;
let drawn = null;

const handlers = {
  set(news) {
    if (set && news.life !== set.life) startAnew();
    set = news;
    heard = performance.now();
    orders.allow(news.control);
    state(news.up ? "up" : "down", news.up ? "connected" : `down: ${news.reason}`);
  },
  picture(news) {
    const first = picture === null;
    picture = news;
    heard = performance.now();
    if (axes.show(news)) orders.axes(news);
    if (first) {
      frames.head(news);
      recall();
    }
    digital.show(news, set.control);
    showFacts(news);
  },
  frames: (news) => frames.add(news),
  events: (news) => events.add(news),
};

/** What is going on, in the header and in colours. */
function state(name, text) {
  document.body.dataset.state = name;
  write(byId("state-text"), text);
  byId("state").title = text;
}

/** The server tells everything it keeps again: to a new connection, and of a new set. */
function startAnew() {
  picture = null;
  axes.forgetCurves();
  events.clear();
  frames.clear();
}

/** Fetches what the curves looked like before this page was opened. */
async function recall() {
  const response = await fetch("api/snapshot?history=200&frames=0&events=0", { headers: authorization() });
  if (!response.ok) return;
  const before = await response.json();
  if (before.life === set?.life) axes.precede(before);
}

/** Asks for the token, and waits for it. */
function token() {
  const form = byId("token");
  form.hidden = false;
  byId("token-field").focus();
  return new Promise((given) => {
    form.onsubmit = (event) => {
      event.preventDefault();
      keepToken(byId("token-field").value.trim());
      byId("token-field").value = "";
      form.hidden = true;
      given();
    };
  });
}

async function connect() {
  connection = new AbortController();
  const query = frames.samples ? "?samples=true" : "";
  const { signal } = connection;
  const response = await fetch(`api/events${query}`, { headers: authorization(), signal, cache: "no-store" });
  if (response.status === 401) {
    state("locked", "locked");
    await token();
    return true;
  }
  if (!response.ok) throw new Error((await complaint(response)).message);
  startAnew();
  for await (const { name, data } of eventsOf(response)) handlers[name]?.(data);
  throw new Error("the server has ended");
}

async function watch() {
  for (let wait = 500; ; wait = Math.min(wait * 1.5, 4000)) {
    try {
      if (await connect()) continue;
    } catch (error) {
      if (error.name === "AbortError") continue;
      if (document.body.dataset.state !== "lost") wait = 500;
      state("lost", `no connection: ${error.message}; trying again`);
    }
    await new Promise((over) => setTimeout(over, wait));
  }
}

/** Draws what has come, once a frame of the screen at most. */
function draw() {
  if (picture !== drawn) {
    drawn = picture;
    if (picture) axes.draw(picture.at_s);
    frames.draw();
  }
  requestAnimationFrame(draw);
}

setInterval(() => {
  const silent = performance.now() - heard;
  if (document.body.dataset.state === "up" && silent > SILENCE) state("silent", "no news from the set");
  else if (document.body.dataset.state === "silent" && silent < SILENCE) state("up", "connected");
}, 500);

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
readColours();
takeToken();
requestAnimationFrame(draw);
watch();
