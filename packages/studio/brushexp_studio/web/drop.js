// A target for dropping or choosing a picture. The picture is sent to the studio, whose reply is the event "answer".
// With "whole", a drop anywhere on the page counts; otherwise the browser would open the file.
export default {
  template: `
    <label class="drop" :data-over="over || null" @dragover.prevent="over = true" @dragleave="over = false"
      @drop.prevent="take($event.dataTransfer.files[0])">
      <input class="unseen" type="file" accept="image/*,.tif,.tiff" :aria-label="name" @change="chosen">
      <span>{{ busy ? "Reading …" : text }}</span>
    </label>`,
  props: { name: String, text: String, address: String, whole: Boolean },
  data: () => ({ over: false, busy: false }),
  mounted() {
    if (!this.whole) return;
    window.addEventListener("dragover", this.hover);
    window.addEventListener("drop", this.catch);
  },
  unmounted() {
    window.removeEventListener("dragover", this.hover);
    window.removeEventListener("drop", this.catch);
  },
  methods: {
    hover(event) {
      event.preventDefault();
    },
    catch(event) {
      if (event.defaultPrevented) return; // another target has accepted the file
      event.preventDefault();
      this.take(event.dataTransfer?.files[0]);
    },
    chosen(event) {
      this.take(event.target.files[0]);
      event.target.value = ""; // allows the same file to be chosen again
    },
    async take(file) {
      this.over = false;
      if (!file) return;
      this.busy = true;
      const headers = { "Content-Type": "application/octet-stream", "X-Name": encodeURIComponent(file.name) };
      try {
        const answer = await fetch(this.address, { method: "POST", body: file, headers });
        this.$emit("answer", await answer.json());
      } catch {
        this.$emit("answer", { error: "the studio does not answer; is it still running?" });
      }
      this.busy = false;
    },
  },
};
