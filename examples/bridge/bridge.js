// A client of the bridge for browsers: one frame out, one state back. docs/reference/bridge.md has the messages.
export class Bridge {
  // url: such as ws://127.0.0.1:8765; onEvent is called with each event.
  constructor(url, onEvent = () => {}) {
    this.waiting = [];
    this.socket = new WebSocket(`${url}/command`);
    this.welcome = new Promise((resolve, reject) => {
      this.socket.onmessage = ({ data }) => {
        const message = JSON.parse(data);
        if (message.type === "welcome") resolve(message);
        else if (message.type === "event") {
          if (message.kind === "ended") this.ended = message.text;
          onEvent(message);
        }
        else if (message.type === "state") this.waiting.shift()?.resolve(message);
        else this.waiting.shift()?.reject(new Error(message.reason));
      };
      this.socket.onclose = ({ reason }) => {
        this.gone = new Error(reason || `the bridge has gone: ${this.ended ?? "no reason given"}`);
        reject(this.gone);
        this.waiting.forEach((each) => each.reject(this.gone));
        this.waiting = [];
      };
    });
  }

  // Where the bodies are at a time in s, by name: { hand: { position: [x, y, z] } }; effects, by name.
  frame(time, bodies, effects = null, sequence = 0) {
    return new Promise((resolve, reject) => {
      if (this.gone) return reject(this.gone); // a socket that is closed takes what is sent without a word
      this.waiting.push({ resolve, reject });
      this.socket.send(JSON.stringify({ type: "frame", time, bodies, effects, sequence }));
    });
  }

  close() {
    this.socket.close();
  }
}
