// Calls the worker. It is a blob that imports the script, so that the page's rule of what it may fetch holds there too.

let worker, waiting, next;
const listeners = { progress() {}, live() {}, restart() {} };

export function listen(to) {
  Object.assign(listeners, to);
}

function start() {
  const address = new URL("worker.js", import.meta.url).href;
  const code = new Blob([`import ${JSON.stringify(address)};`], { type: "text/javascript" });
  worker = new Worker(URL.createObjectURL(code), { type: "module" });
  waiting = new Map();
  next = 0;
  // Messages that come before the script has been read are kept here, since a blob's module is there before its import.
  worker.onmessage = ({ data: { id, answer, error, isBroken, progress, live } }) => {
    if (progress) return listeners.progress(progress);
    if (live) return listeners.live(live);
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (isBroken) {
      restart();
      reject(new Error("The file stopped Anyface, which has started again. Choose another head."));
    } else if (error !== undefined) reject(new Error(error));
    else resolve(answer);
  };
  worker.onerror = (event) => fail(event.message ?? "its script could not be read");
}

function fail(message) {
  for (const { reject } of waiting.values()) reject(new Error(`Anyface did not start: ${message}.`));
  waiting.clear();
}

function restart() {
  worker.terminate();
  fail("a file stopped it");
  start();
  listeners.restart();
  // Whoever waits for it hears of its failure by the next call.
  call("load").catch(() => {});
}

export function call(kind, message = {}, buffers = []) {
  if (!worker) start();
  return new Promise((resolve, reject) => {
    const id = next++;
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, kind, ...message }, buffers);
  });
}
