// Of a plot's data the server sends only what is new (app/dashboard/transport/plot_feed.py). Here it becomes whole arrays
// again before viser's program, which knows no others, reads the message: so a plot that is built anew has all of it.
const plots = new Map(); // by the plot's id: { mark, number, at, lines, empty }
const keep = (id, { data, value: { mark, at } }) => {
  const lines = data.slice(1).filter((line) => line.length);
  plots.set(id, { mark, number: 0, at, lines, empty: data.slice(1 + lines.length) });
};
const further = (id, { mark, number, after, now, begin, stay, at, values }) => {
  const plot = plots.get(id);
  if (!plot || plot.mark !== mark || plot.number < after || plot.number >= number) return null;
  let from = 0;
  while (from < plot.at.length && plot.at[from] < begin - 5e-7) from += 1;
  if (plot.at.length < from + stay) return null;
  const joined = (old, added) => {
    const all = new old.constructor(stay + at.length);
    all.set(old.subarray(from, from + stay));
    all.set(added, stay);
    return all;
  };
  plot.lines = plot.lines.map((line, k) => joined(line, values.subarray(k * at.length, (k + 1) * at.length)));
  [plot.at, plot.number] = [joined(plot.at, at), number];
  return [Float32Array.from(plot.at, (t) => t - now), ...plot.lines, ...plot.empty];
};
// Whether there is anything for viser in a message.
const read = ({ type, uuid, updates }) => {
  if (type !== "GuiUpdateMessage" || updates.value?.mark === undefined) return true;
  if (updates.data) keep(uuid, updates);
  else {
    const data = further(uuid, updates.value);
    if (!data) window.dispatchEvent(new Event("vsmrc-behind"));
    updates.data = data;
  }
  delete updates.value;
  return updates.data !== null;
};
const { get } = Object.getOwnPropertyDescriptor(MessageEvent.prototype, "data"), done = new WeakSet();
Object.defineProperty(MessageEvent.prototype, "data", {
  configurable: true,
  enumerable: true,
  get() {
    const data = get.call(this);
    if (data?.type === "message_batch" && this.target instanceof Worker && !done.has(data)) {
      done.add(data);
      data.messages = data.messages.filter(read);
    }
    return data;
  },
});
