#include <avr/io.h>
#include <avr/sleep.h>
#include <stdio.h>
static int put(char c, FILE *f)
{
    (void)f;
    while ((UCSR0A & (1 << UDRE0)) == 0) continue;
    UDR0 = (unsigned char)c;
    return 0;
}
static FILE serial = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
int MAIN(void);
int main(void)
{
    UCSR0B = 1 << TXEN0, stdout = &serial;
    printf("%d\n\n", MAIN());
    sleep_mode();
}
