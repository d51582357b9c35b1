// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

enum esp_reset_reason_t {
  ESP_RST_UNKNOWN,
  ESP_RST_POWERON,
  ESP_RST_EXT,
  ESP_RST_SW,
  ESP_RST_PANIC,
  ESP_RST_INT_WDT,
  ESP_RST_TASK_WDT,
  ESP_RST_WDT,
  ESP_RST_DEEPSLEEP,
  ESP_RST_BROWNOUT,
  ESP_RST_SDIO
};
esp_reset_reason_t esp_reset_reason();
