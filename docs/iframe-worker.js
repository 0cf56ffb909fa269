// Search in pages that are opened from a folder: browsers start no worker from a file, so a hidden frame runs its script.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      frame.srcdoc = `<script src="${url}"></script>`
      this.scope = new Promise((ready) => {
        frame.onload = () => {
          frame.contentWindow.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
          ready(frame.contentWindow)
        }
      })
      document.body.append(frame)
    }

    async postMessage(data) {
      ;(await this.scope).dispatchEvent(new MessageEvent("message", { data }))
    }
  }
}
