// The connection to `fmfts-daemon view`: messages of the bus, answers to requests, and the daemon's clock.

const RETRY_MS = 500, PING_MS = 1000, KEPT_PINGS = 10;
const WRONG_TOKEN = 4401, TOO_MANY = 4429, FULL_RETRY_MS = 5000;

function token() {
  const given = location.hash.slice(1);
  if (given) {
    sessionStorage.setItem("fmfts-token", given);
    history.replaceState(null, "", location.pathname); // so that no screenshot and no history shows it
  }
  return sessionStorage.getItem("fmfts-token") ?? "";
}

export class Link extends EventTarget {
  // Events: "message" {topic, body}, "state" {state, why}, "said" (an answer without id).
  constructor() {
    super();
    this.token = token();
    this.waiting = new Map();
    this.lastId = 0;
    this.watched = { ask: "watch", detail: null, hidden: document.hidden };
    this.pings = [];
    this.aheadMs = null; // daemon's clock less this page's performance.now()
    this.connect();
    setInterval(() => this.ping(), PING_MS);
    document.addEventListener("visibilitychange", () => this.watch({ hidden: document.hidden }));
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = (this.socket = new WebSocket(`${scheme}://${location.host}${location.pathname.replace(/[^/]*$/, "socket")}`));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      socket.send(JSON.stringify({ token: this.token }));
      this.send(this.watched);
      this.pings = [];
      this.ping();
      this.tell("state", { state: "open", why: "" });
    };
    socket.onmessage = (event) => (typeof event.data === "string" ? this.answer(JSON.parse(event.data)) : this.take(event.data));
    socket.onclose = (event) => {
      for (const { reject } of this.waiting.values()) reject(new Error("the connection to fmfts-daemon view was lost"));
      this.waiting.clear();
      if (event.code === WRONG_TOKEN) {
        this.tell("state", { state: "refused", why: "This page has no valid token. Open the address that fmfts-daemon view printed, with all that follows #." });
        return;
      }
      if (event.code === TOO_MANY) {
        this.tell("state", { state: "gone", why: `${event.reason}. This page tries again by itself.` });
        setTimeout(() => this.connect(), FULL_RETRY_MS);
        return;
      }
      this.tell("state", { state: "gone", why: "The server of this page does not answer. Is `fmfts-daemon view` running? The page tries again by itself." });
      setTimeout(() => this.connect(), RETRY_MS);
    };
  }

  // Values that follow each other: topic, body, topic, body …; whole numbers beyond 2^53 arrive as BigInt.
  take(data) {
    let topic = null;
    for (const value of MessagePack.decodeMulti(new Uint8Array(data), { useBigInt64: true })) {
      if (topic === null) topic = value;
      else {
        this.tell("message", { topic, body: value });
        topic = null;
      }
    }
    this.tell("batch", {});
  }

  answer(reply) {
    if ("pong" in reply) this.setClock(reply);
    const asked = this.waiting.get(reply.id);
    if (asked === undefined) this.tell("said", reply);
    else if ("progress" in reply) asked.progress(reply.progress);
    else {
      this.waiting.delete(reply.id);
      if ("error" in reply) asked.reject(new Error(reply.error));
      else asked.resolve(reply);
    }
  }

  // Resolves with {done, lines}; rejects with the daemon's sentence.
  request(ask, rest = {}, progress = () => {}) {
    const id = ++this.lastId;
    return new Promise((resolve, reject) => {
      if (!this.send({ ask, id, ...rest })) reject(new Error("there is no connection to fmfts-daemon view"));
      else this.waiting.set(id, { resolve, reject, progress });
    });
  }

  watch(change) {
    this.watched = { ...this.watched, ...change };
    this.send(this.watched);
  }

  send(value) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(value));
    return true;
  }

  ping() {
    this.send({ ask: "ping", sent_ms: performance.now() });
  }

  // The answer of the shortest way tells the clock best: its error is at most half that way.
  setClock({ pong, now_ns }) {
    const now = performance.now();
    if (now_ns === null) return void (this.aheadMs = null);
    this.pings.push({ way: now - pong, ahead: now_ns / 1e6 - (now + pong) / 2 });
    if (this.pings.length > KEPT_PINGS) this.pings.shift();
    this.aheadMs = this.pings.reduce((best, one) => (one.way < best.way ? one : best)).ahead;
  }

  // Milliseconds on the daemon's clock; null while it is not known.
  daemonMs() {
    return this.aheadMs === null ? null : performance.now() + this.aheadMs;
  }

  tell(kind, detail) {
    this.dispatchEvent(Object.assign(new Event(kind), { detail }));
  }
}
