// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stdint.h>

typedef enum { ESP_BT_NON_CONNECTABLE, ESP_BT_CONNECTABLE } esp_bt_connection_mode_t;
typedef enum {
  ESP_BT_NON_DISCOVERABLE,
  ESP_BT_LIMITED_DISCOVERABLE,
  ESP_BT_GENERAL_DISCOVERABLE
} esp_bt_discovery_mode_t;
typedef enum { ESP_BT_SP_IOCAP_MODE = 0 } esp_bt_sp_param_t;
typedef uint8_t esp_bt_io_cap_t;
#define ESP_BT_IO_CAP_OUT 0
#define ESP_BT_IO_CAP_IO 1
#define ESP_BT_IO_CAP_IN 2
#define ESP_BT_IO_CAP_NONE 3
int esp_bt_gap_set_security_param(esp_bt_sp_param_t param, void* value, uint8_t size);
int esp_bt_gap_set_scan_mode(esp_bt_connection_mode_t connection, esp_bt_discovery_mode_t discovery);
