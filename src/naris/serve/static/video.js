// A video that was dropped on the page: played there, and of the frame that it stands at a picture is made.

/** What a browser may be able to play, by the end of a name. */
export const VIDEO = /\.(mp4|m4v|mov|webm|mkv|ogv|avi|mpe?g)$/i;

const REST_MS = 200;

export class Video {
  /** `stands(picture, name)` is called with each frame that the video comes to rest at; `failed(sentence)` if it has none. */
  constructor(figure, player, caption, stands, failed) {
    Object.assign(this, { figure, player, caption, stands, failed });
    this.name = "";
    for (const kind of ["pause", "seeked", "loadeddata"]) player.addEventListener(kind, () => this.#rest());
    player.addEventListener("error", () => {
      if (!player.hasAttribute("src")) return;
      const name = this.name;
      this.close();
      failed(`expected a video that this browser can play (MP4 with H.264, WebM), got ${name}: convert it`);
    });
  }

  open(file) {
    this.close();
    this.name = file.name;
    this.url = URL.createObjectURL(file);
    this.player.src = this.url;
    this.figure.hidden = false;
    this.caption.textContent = file.name;
  }

  close() {
    this.figure.hidden = true;
    this.player.pause();
    this.player.removeAttribute("src");
    this.player.load();
    if (this.url) URL.revokeObjectURL(this.url);
    this.url = null;
  }

  /** The frame that it stands at, as a picture of its own size. */
  async frame() {
    const canvas = document.createElement("canvas");
    canvas.width = this.player.videoWidth;
    canvas.height = this.player.videoHeight;
    canvas.getContext("2d").drawImage(this.player, 0, 0);
    return new Promise((done) => canvas.toBlob(done, "image/png"));
  }

  /** Only a frame at which it stays for a moment counts, and each one once. */
  #rest() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.#tell(), REST_MS);
  }

  async #tell() {
    const { player, url, name } = this;
    const at = player.currentTime, still = `${url} ${at}`;
    const rests = () => this.url === url && player.paused && !player.seeking && player.currentTime === at;
    if (!url || !player.videoWidth || !rests() || this.told === still) return;
    this.told = still;
    const picture = await this.frame();
    if (rests()) this.stands(picture, `${name} at ${at.toFixed(2)} s`);
  }
}
