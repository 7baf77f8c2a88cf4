// Of a page that is opened from a folder: search in a hidden frame, as browsers refuse workers there.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.appendChild(frame)
      const inner = this.inner = frame.contentWindow
      addEventListener("message", event => {
        if (event.source !== inner) return
        const message = new MessageEvent("message", { data: event.data })
        this.dispatchEvent(message)
        if (this.onmessage) this.onmessage(message)
      })
      inner.document.open()
      inner.document.write(`<script>
        postMessage = data => parent.dispatchEvent(
          new MessageEvent("message", { data, source: window }))
        importScripts = (...urls) => urls.reduce((done, url) => done.then(() => new Promise(
          (next, fail) => {
            const script = document.createElement("script")
            Object.assign(script, { src: url, onload: next, onerror: fail })
            document.body.appendChild(script)
          })), Promise.resolve())
      <\/script><body><script src="${url}"><\/script></body>`)
      inner.document.close()
      this.ready = new Promise(next => { inner.addEventListener("load", next) })
    }
    postMessage(data) {
      this.ready.then(() => this.inner.dispatchEvent(new MessageEvent("message", { data })))
    }
    terminate() {}
  }
}
